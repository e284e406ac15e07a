"""Images from one process to another through memory that both see."""

import mmap
import os

import numpy as np
from numpy.typing import NDArray

SLOTS = 8
"""A quarter of a second at 30 Hz, for a reader that is late."""
_EMPTY, _WRITING = -1, -2


class FrameRing:
    """The last few images, each in a slot that says which one it holds.

    The memory has no name (memfd_create), so that nothing is left behind however its processes end. One process
    writes and another reads; a reader that is overtaken while it copies is told so.
    """

    def __init__(self, descriptor: int, width: int, height: int) -> None:
        self._descriptor = descriptor
        self._shape = (SLOTS, height, width)
        self._memory = mmap.mmap(descriptor, self.size(width, height))
        self._holds = np.frombuffer(self._memory, np.int64, SLOTS)
        self._images = np.frombuffer(self._memory, np.uint8, offset=self._holds.nbytes).reshape(self._shape)

    @staticmethod
    def size(width: int, height: int) -> int:
        """Bytes that images of ``width`` by ``height`` pixels need."""
        return SLOTS * (8 + width * height)

    @classmethod
    def make(cls, width: int, height: int) -> "FrameRing":
        """A new, empty ring."""
        descriptor = os.memfd_create("frames")
        os.ftruncate(descriptor, cls.size(width, height))
        ring = cls(descriptor, width, height)
        ring._holds[:] = _EMPTY
        return ring

    @property
    def descriptor(self) -> int:
        """To be given to the other process."""
        return self._descriptor

    def write(self, sequence: int, image: NDArray[np.uint8]) -> int:
        """Put in ``image`` (height, width) under ``sequence`` ≥ 0; its slot."""
        slot = sequence % SLOTS
        self._holds[slot] = _WRITING
        self._images[slot] = image
        self._holds[slot] = sequence
        return slot

    def read(self, slot: int, sequence: int) -> NDArray[np.uint8] | None:
        """A copy of the image ``sequence`` in ``slot``; None if another has taken its place."""
        if self._holds[slot] != sequence:
            return None
        image = self._images[slot].copy()
        return image if self._holds[slot] == sequence else None

    def close(self) -> None:
        """Give the memory back; nothing may be read or written afterwards."""
        del self._holds, self._images
        self._memory.close()
        os.close(self._descriptor)
