"""Noticing a gate that is not where the map has it: it should be plain to see, and nothing is seen of it."""

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_yaw, quat_to_matrix
from flightapp.messages import GateEstimate
from flightapp.track import Track

LOOKS = 20
"""Frames in a row in which a gate should have been seen, after which it is missing."""
NEAREST = 1.5
"""m, nearer gates are not wholly in the image."""
REACH = 0.5
"""Share of ``detection.max_distance`` within which a marker that is in the image is found."""
LEAST_COSINE = 0.6
"""Between the line of sight and the gate's normal: seen more obliquely it may be overlooked."""
MARGIN = 40.0
"""px from the image's border that all markers must be."""
SIGMA = 0.3
"""m, greatest standard deviation of a gate's place at which it can be expected to be in the image."""


class AbsenceWatch:
    """Counts, for each gate of ``track``, the frames in which it should have been seen and was not."""

    def __init__(self, config: Config, track: Track) -> None:
        self._camera = config.camera.model()
        self._reach = REACH * config.detection.max_distance
        self._markers = track.gate.marker_corners().reshape(-1, 3)
        self._missed: dict[int, int] = {}

    def look(self, gate: GateEstimate, seen: bool, position: Vector, orientation: Vector) -> bool:
        """Take one frame into account, made at ``position`` (3,) with ``orientation`` (4,) q_wb; True if it is missing.

        ``seen`` says whether anything was seen of ``gate``. It is told once, and again after as many frames.
        """
        if seen:
            self._missed[gate.gate_id] = 0
        elif self._plain(gate, position, orientation):
            self._missed[gate.gate_id] = self._missed.get(gate.gate_id, 0) + 1
            if self._missed[gate.gate_id] >= LOOKS:
                self._missed[gate.gate_id] = 0
                return True
        return False

    def _plain(self, gate: GateEstimate, position: Vector, orientation: Vector) -> bool:
        """Whether all of the gate's markers should be in the image, near and turned to the camera."""
        way = gate.position - position
        distance = float(np.linalg.norm(way))
        ahead = np.array((np.cos(gate.yaw), np.sin(gate.yaw), 0.0))
        if not NEAREST <= distance <= self._reach or float(way @ ahead) < LEAST_COSINE * distance:
            return False
        if float(np.diag(gate.covariance)[:3].max()) > SIGMA**2:
            return False
        camera, R_wb = self._camera, quat_to_matrix(orientation)
        corners = self._markers @ quat_to_matrix(quat_from_yaw(gate.yaw)).T + way
        rays = (corners @ R_wb - camera.p_bc) @ camera.R_bc
        if float(rays[:, 2].min()) <= 0.0:
            return False
        pixels = camera.project(rays)
        size = np.array((camera.width, camera.height))
        return bool(((pixels >= MARGIN) & (pixels <= size - MARGIN)).all())
