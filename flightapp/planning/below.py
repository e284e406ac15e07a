"""What stands below a place: where a vehicle that sinks from it would meet a frame or an obstacle."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.messages import GateEstimate
from flightapp.planning.course import horizontal_sigma, is_known
from flightapp.planning.obstacles import CENTRE, COS, CYLINDER, HALF, KIND, MARGIN, OWNER, SIN, Margins, names, packed
from flightapp.track import Track

ASIDE = 0.3
"""m that an autopilot's landing may go aside."""
SIGMAS = 2.0
"""Standard deviations of a gate's place for which there must be room."""


class Below:
    """The column of air under a place, down to the ground, between the obstacles and frames that are known.

    It is as wide as the vehicle with what plans keep clear of (`Margins`), how far a landing goes aside and what is
    not known of a gate's place.
    """

    def __init__(self, config: Config, track: Track, gates: Sequence[GateEstimate]) -> None:
        known = [gate for gate in gates if is_known(gate, config.mapping.known_sigma)]
        margins = replace(Margins.of(config), sigmas=0.0)
        self._radius = margins.radius
        self._rows = packed(track.obstacles, known, track.gate, margins)
        self._names = names(track.obstacles, known)
        self._widen(known, len(track.obstacles))

    def _widen(self, gates: Sequence[GateEstimate], first: int) -> None:
        self._rows[:, MARGIN] += ASIDE
        for owner, gate in enumerate(gates, first):
            self._rows[self._rows[:, OWNER] == owner, MARGIN] += SIGMAS * horizontal_sigma(gate)

    def free(self, places: Vector) -> NDArray[np.bool_]:
        """(n,) whether nothing stands below each of ``places`` (n, 3) m, world."""
        clear: NDArray[np.bool_] = np.logical_and.reduce(self._gaps(places) >= 0.0, axis=1)
        return clear

    def what(self, place: Vector) -> str:
        """What stands below ``place`` (3,) m, in words; empty for nothing."""
        gaps = self._gaps(place[None])[0]
        if not (gaps < 0.0).any():
            return ""
        return self._names[int(self._rows[int(gaps.argmin()), OWNER])]

    def _gaps(self, places: Vector) -> Vector:
        """(n, k) m of room between each place's column and each row; infinite for what hangs above the place."""
        rows = self._rows
        x, y = (places[:, axis, None] - rows[:, CENTRE + axis] for axis in range(2))
        along = np.abs(rows[:, COS] * x + rows[:, SIN] * y) - rows[:, HALF]
        across = np.abs(rows[:, COS] * y - rows[:, SIN] * x) - rows[:, HALF + 1]
        box = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        gap = np.where(rows[:, KIND] == CYLINDER, np.hypot(x, y) - rows[:, HALF], box) - rows[:, MARGIN]
        bottom = rows[:, CENTRE + 2] - rows[:, HALF + 2]
        above = places[:, 2, None] + self._radius < bottom
        return np.where(above, math.inf, gap)
