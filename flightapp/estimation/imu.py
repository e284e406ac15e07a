"""The autopilot's recent inertial measurements, to be asked for what was felt between two poses."""

import math
from collections import deque

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import ImuSample

SPAN = 0.2
"""s that are remembered."""
BRIDGED = 0.012
"""s between samples for which the later one stands."""
REACH = 0.03
"""s for which the last sample stands for what follows, where newer ones are still on their way."""
GREATEST_FORCE = 400.0
"""m/s², beyond what any accelerometer of a vehicle measures (40 g)."""
GREATEST_RATE = 70.0
"""rad/s, beyond what any gyro of a vehicle measures (4000 °/s)."""


class ImuMemory:
    """Samples of the last `SPAN` seconds, in order of their stamps."""

    def __init__(self) -> None:
        self._samples: deque[ImuSample] = deque()
        self.refused = 0
        """Samples that were not finite, impossible or out of order."""

    def add(self, sample: ImuSample) -> bool:
        """Take ``sample`` over; False where it cannot be used."""
        numbers = (*sample.specific_force.tolist(), *sample.angular_velocity.tolist())
        sound = all(map(math.isfinite, (sample.stamp, *numbers)))
        sound = sound and max(map(abs, numbers[:3])) < GREATEST_FORCE and max(map(abs, numbers[3:])) < GREATEST_RATE
        samples = self._samples
        if not sound or (samples and sample.stamp <= samples[-1].stamp):
            self.refused += 1
            return False
        samples.append(sample)
        while samples[0].stamp < sample.stamp - SPAN:
            samples.popleft()
        return True

    def felt(self, begin: float, end: float) -> tuple[Vector, float] | None:
        """(3,) mean specific force from ``begin`` to ``end`` (m/s², body), and the share of the time that it tells of.

        None where nothing tells of it.
        """
        total, count, after, hole = None, 0, end, 0.0
        for sample in reversed(self._samples):
            if sample.stamp > end + 1e-6:
                continue
            if not count and sample.stamp < end - REACH:
                return None
            hole += max(after - max(sample.stamp, begin) - BRIDGED, 0.0)
            after = sample.stamp
            if count and sample.stamp <= begin + 1e-6:
                break
            total = sample.specific_force if total is None else total + sample.specific_force
            count += 1
            if sample.stamp <= begin + 1e-6:
                break
        if total is None:
            return None
        # Older than what is remembered is as if it had not been felt.
        hole += max(after - begin - BRIDGED, 0.0)
        return np.asarray(total / count, float), 1.0 - min(hole / (end - begin), 1.0)
