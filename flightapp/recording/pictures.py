"""Camera images out of a log: Foxglove's CompressedImage, read with its own schema."""

from foxglove.messages import CompressedImage
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from flightapp.evaluation.flight import Picture

PICTURE = "foxglove.CompressedImage"
"""The name of their schema."""


def _pool() -> descriptor_pool.DescriptorPool:
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(CompressedImage.get_schema().data).file:
        pool.Add(file)
    return pool


_parse = message_factory.GetMessageClass(_pool().FindMessageTypeByName(PICTURE)).FromString


def picture(payload: bytes) -> Picture:
    """The image in ``payload``; raises DecodeError where it is none."""
    message = _parse(payload)
    return Picture(message.timestamp.seconds + 1e-9 * message.timestamp.nanos, message.data)
