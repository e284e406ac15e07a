"""Images of a flight that say most: the best view of each gate, with what was detected and what was believed drawn."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from flightapp.evaluation.figures import Subject
from flightapp.evaluation.flight import Flight, Motions, Picture
from flightapp.evaluation.gates import gate_outline
from flightapp.evaluation.metrics import interpolated
from flightapp.evaluation.space import camera_of
from flightapp.frames import quat_normalize, quat_to_matrix
from flightapp.messages import GateEstimate, Sightings
from flightapp.perception.camera import CameraModel

MOST = 9
"""Images at most."""
LARGEST = 60_000
"""bytes of one, as JPEG."""
WIDTH = 640
"""px, the most."""
QUALITIES = (80, 65, 50, 35, 20)
LEGIBLE = 24
"""px, markers as wide as that are named."""
NEAR = 0.15
"""m before the camera, from where on a gate is drawn."""
STEPS = 12
"""Points along one side of a gate: a lens bends it."""

Image = NDArray[np.uint8]
_MARKER, _GATE = (60, 200, 60), (30, 135, 232)
"""BGR."""


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """An image for the report."""

    caption: str
    jpeg: bytes

    @property
    def uri(self) -> str:
        """The image as a data URI."""
        return f"data:image/jpeg;base64,{base64.b64encode(self.jpeg).decode()}"


def key_frames(subject: Subject) -> Sequence[KeyFrame]:
    """The images, in the order of time; none where none were recorded."""
    flight, camera = subject.flight, camera_of(subject.flight)
    seen = {round(sighting.stamp, 6): sighting for sighting in flight.sightings}
    made = []
    for stamp, reason in sorted(chosen(flight).items())[:MOST]:
        picture = next(picture for picture in flight.pictures if picture.stamp == stamp)
        image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            continue
        sighting = seen.get(round(stamp, 6))
        drawn = np.asarray(image, np.uint8)
        if camera is not None and flight.states.stamp.size:
            _draw_gates(drawn, subject, camera.model(), stamp)
        _draw_markers(drawn, sighting)
        time = stamp - subject.window.start
        made.append(KeyFrame(f"{time:.2f} s: {reason}", _encoded(drawn)))
    return made


def chosen(flight: Flight) -> Mapping[float, str]:
    """Stamps of the images to show, and why: of each gate the one with most of its markers, of these the nearest.

    Where no gate was ever seen, a few images from all of the flight.
    """
    by_stamp = {round(picture.stamp, 6): picture.stamp for picture in flight.pictures}
    best: dict[int, tuple[int, float, float]] = {}
    for sighting in flight.sightings:
        stamp = by_stamp.get(round(sighting.stamp, 6))
        for gate in sighting.gates if stamp is not None else ():
            view = (gate.markers, -float(np.linalg.norm(gate.position)), by_stamp[round(sighting.stamp, 6)])
            best[gate.gate_id] = max(best.get(gate.gate_id, view), view)
    reasons: dict[float, str] = {}
    for gate_id, (markers, distance, stamp) in sorted(best.items()):
        plural = "" if markers == 1 else "s"
        told = f"gate {gate_id}, {markers} marker{plural}, {-distance:.1f} m away"
        reasons[stamp] = f"{reasons[stamp]}; {told}" if stamp in reasons else told
    if not reasons:
        few: Iterable[Picture] = flight.pictures[:: max(1, len(flight.pictures) // 3)]
        reasons = {picture.stamp: "no gate was seen" for picture in few}
    return reasons


def _draw_markers(image: Image, sighting: Sightings | None) -> None:
    for marker in sighting.markers if sighting is not None else ():
        corners = np.round(8.0 * marker.corners).astype(np.int32)
        cv2.polylines(image, [corners.reshape(-1, 1, 2)], True, _MARKER, 2, cv2.LINE_AA, 3)
        if np.ptp(marker.corners[:, 0]) > LEGIBLE:
            right, top = marker.corners[:, 0].max(), marker.corners[:, 1].min()
            _write(image, str(marker.marker_id), (int(right) + 4, int(top) + 12), _MARKER)


def _draw_gates(image: Image, subject: Subject, camera: CameraModel, stamp: float) -> None:
    """The openings of the gates as the map had them, seen from where the vehicle was believed to be."""
    flight = subject.flight
    maps = [known for known in flight.maps if known.stamp <= stamp] or flight.maps[:1]
    position = interpolated(flight.states.stamp, flight.states.position, np.array([stamp]))[0]
    R_wb = quat_to_matrix(_orientation(flight.states, stamp))
    for gate in maps[-1].gates if maps else ():
        corners = _bent(gate_outline(gate.position, gate.yaw, subject.opening))
        in_camera = ((corners - position) @ R_wb - camera.p_bc) @ camera.R_bc
        before = in_camera[:, 2] > NEAR
        pixels = camera.project(in_camera[before])
        if not before.all() or not camera.contains(pixels).any():
            continue
        scaled = np.round(8.0 * pixels).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(image, [scaled], True, _GATE, 2, cv2.LINE_AA, 3)
        _label_gate(image, gate, pixels)


def _label_gate(image: Image, gate: GateEstimate, pixels: NDArray[np.float64]) -> None:
    height, width = image.shape[:2]
    x = int(np.clip(pixels[:, 0].mean() - 36, 2, width - 76))
    y = int(np.clip(pixels[:, 1].max() + 22, 20, height - 6))
    _write(image, f"gate {gate.gate_id}", (x, y), _GATE)


def _bent(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """``outline`` (5, 3) with more points along its sides."""
    part = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    return np.concatenate([a + part * (b - a) for a, b in pairwise(outline)])


def _orientation(motion: Motions, stamp: float) -> NDArray[np.float64]:
    after = int(np.clip(np.searchsorted(motion.stamp, stamp), 1, max(motion.stamp.size - 1, 1)))
    pair = motion.orientation[after - 1 : after + 1]
    nearest: NDArray[np.float64] = pair[int(np.argmin(np.abs(motion.stamp[after - 1 : after + 1] - stamp)))]
    return quat_normalize(nearest)


def _write(image: Image, text: str, place: tuple[int, int], colour: tuple[int, int, int]) -> None:
    for pen, width in (((0, 0, 0), 5), (colour, 2)):
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, pen, width, cv2.LINE_AA)


def _encoded(image: Image) -> bytes:
    """As JPEG, `LARGEST` at the most if any quality makes it so small."""
    if image.shape[1] > WIDTH:
        height = round(image.shape[0] * WIDTH / image.shape[1])
        image = np.asarray(cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA), np.uint8)
    data = b""
    for quality in QUALITIES:
        data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))[1].tobytes()
        if len(data) <= LARGEST:
            break
    return data
