"""Finding a camera's mount from recordings: a flight log, or images and a file of poses."""

import math
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from flightapp.calibration.board import Board, BoardFinder
from flightapp.calibration.body_poses import BodyPoses
from flightapp.calibration.mount import MountFound, Sight, find_mount
from flightapp.cameras.names import Kind, Source, parse_source
from flightapp.cameras.recordings import recorded_frames
from flightapp.cameras.shots import check_size
from flightapp.config import Config, load_config
from flightapp.evaluation.flight import Flight, Poses
from flightapp.frames import R_BODY_OPTICAL, Vector, quat_from_matrix, quat_to_euler
from flightapp.inputs import BadInputError, validate
from flightapp.messages import MarkerDetection
from flightapp.modules import find
from flightapp.perception.camera import CameraModel
from flightapp.recording.reader import read_flight
from flightapp.results import log_of
from flightapp.sensors.pose_files import read_poses
from flightapp.track import Track, load_track


@dataclass(frozen=True, slots=True)
class MountQuestion:
    """What is given."""

    recording: Path
    """A flight log, or images."""
    poses: Path | None
    """A file of poses, where they are not in the log."""
    vehicle: Path | None
    overrides: tuple[str, ...]
    board: Board | None
    """What stands still; None for a gate."""
    track: Path | None
    gate: int | None
    """Which of the track's gates; None for the one that was seen most."""


@dataclass(frozen=True, slots=True)
class MountAnswer:
    """What was found, and what it was found from."""

    found: MountFound
    before: CameraModel
    """The camera as it was configured."""
    target: str
    late_before: tuple[float, float]
    """s, camera.latency and camera.driver_delay as they were configured."""

    @property
    def settings(self) -> dict[str, Any]:
        """The mount as the camera section has it."""
        # R_bc = R_tilt R_optical, as in frames.camera_mount
        tilt = np.ascontiguousarray(self.found.R_bc @ R_BODY_OPTICAL.T)
        roll, pitch, yaw = quat_to_euler(quat_from_matrix(tilt))
        degrees = {"pitch_up_deg": -pitch, "roll_deg": roll, "yaw_deg": yaw}
        turned = {name: round(math.degrees(angle), 3) for name, angle in degrees.items()}
        return {**turned, "position": [round(float(value), 4) for value in self.found.p_bc]}


def calibrate_mount(question: MountQuestion) -> MountAnswer:
    """Answer ``question``; raises `BadInputError`."""
    source = parse_source(str(question.recording))
    if source.kind.live:
        raise BadInputError(f"'{source.text}' is live; record a flight, or images and poses, first")
    flight = read_flight(log_of(question.recording)) if source.kind is Kind.LOG else Flight()
    config = _config(question, flight)
    camera = config.camera.model()
    poses = _body_poses(question, flight, config)
    if question.board is not None:
        sights, target = list(_board_sights(source, question.board, config)), str(question.board)
    else:
        track = _track(question, flight)
        seen = _markers(source, flight, track, config)
        gate = question.gate if question.gate is not None else _most_seen(track, seen)
        sights, target = _gate_sights(track, gate, seen), f"gate {gate} of {track.name}"
    try:
        found = find_mount(camera, sights, poses)
    except BadInputError as error:
        raise BadInputError(f"{question.recording}: no mount can be told from {target}: {error}") from None
    return MountAnswer(found, camera, target, (config.camera.latency, config.camera.driver_delay))


def _config(question: MountQuestion, flight: Flight) -> Config:
    """As the log says that it was flown with, unless a vehicle file is given."""
    told = flight.header.get("config", "")
    if question.vehicle is None and told:
        if question.overrides:
            raise BadInputError("--set changes a vehicle file: give --vehicle too")
        try:
            return validate(Config, tomllib.loads(told), str(question.recording))
        except tomllib.TOMLDecodeError as error:
            raise BadInputError(f"{question.recording}: its configuration cannot be read: {error}") from None
    if question.vehicle is None:
        raise BadInputError("name the vehicle file with the camera's calibration: --vehicle FILE")
    return load_config(question.vehicle, None, question.overrides)


def _track(question: MountQuestion, flight: Flight) -> Track:
    if question.track is not None:
        return load_track(question.track)
    if "track" not in flight.header:
        raise BadInputError("say what stands still: --track FILE for a gate, or --board")
    return Track.model_validate_json(flight.header["track"])


def _body_poses(question: MountQuestion, flight: Flight, config: Config) -> BodyPoses:
    """The body's poses in one frame of the tracker: its longest."""
    if question.poses is not None:
        recording = read_poses(question.poses)
        poses, of_body = recording.poses, recording.of_body
    else:
        poses, of_body = flight.poses, True
    if not len(poses.stamp):
        raise BadInputError(f"{question.recording}: there are no poses in it; give --poses FILE")
    kept = poses.epoch == Counter(poses.epoch.tolist()).most_common(1)[0][0]
    if of_body:
        return BodyPoses(poses.stamp[kept], poses.position[kept], poses.orientation[kept])
    return _unmounted(poses, kept, config)


def _unmounted(poses: Poses, kept: Vector, config: Config) -> BodyPoses:
    """What the tracker itself said, as the body's: its mount and its delay taken out."""
    sensors = config.sensors
    mount = Rotation.from_euler("ZYX", sensors.mount_rpy_deg[::-1], degrees=True)
    R = Rotation.from_quat(poses.orientation[kept], scalar_first=True) * mount.inv()
    position = poses.position[kept] - R.apply(sensors.mount_position)
    return BodyPoses(poses.stamp[kept] - sensors.delay, position, R.as_quat(scalar_first=True))


def _board_sights(source: Source, board: Board, config: Config) -> Iterator[Sight]:
    finder, camera = BoardFinder(board), config.camera.model()
    for frame in recorded_frames(source, config.camera.rate):
        if frame.image is None:
            continue
        check_size(frame.image, camera, source.text)
        if (view := finder.find(frame.image, stamp=frame.stamp)) is not None:
            yield Sight(view.stamp, board.corners[view.ids], view.pixels)


Seen = list[tuple[float, tuple[MarkerDetection, ...]]]


def _markers(source: Source, flight: Flight, track: Track, config: Config) -> Seen:
    """Stamps and markers of all images: as the flight found them, else found now."""
    if flight.sightings:
        return [(seen.stamp, seen.markers) for seen in flight.sightings if seen.markers]
    detector, camera = find("detectors", config.detection.detector)(config, track), config.camera.model()
    found: Seen = []
    for frame in recorded_frames(source, config.camera.rate):
        if frame.image is not None:
            check_size(frame.image, camera, source.text)
        found.append((frame.stamp, detector.detect(frame, None)))
    return found


def _most_seen(track: Track, seen: Seen) -> int:
    of = {marker: gate.id for gate in track.passage for marker in gate.markers}
    counts = Counter(of[m.marker_id] for _, markers in seen for m in markers if m.marker_id in of)
    if not counts:
        raise BadInputError(f"no marker of a gate of '{track.name}' was seen")
    return counts.most_common(1)[0][0]


def _gate_sights(track: Track, gate_id: int, seen: Seen) -> list[Sight]:
    """The gate's markers in each image; in a frame of the gate whose plane is z = 0, as a board's."""
    gate = next((gate for gate in track.passage if gate.id == gate_id), None)
    if gate is None:
        ids = ", ".join(str(gate.id) for gate in track.passage)
        raise BadInputError(f"--gate {gate_id}: track '{track.name}' has the gates {ids}")
    corners = track.gate.marker_corners()[:, :, (1, 2, 0)] * (-1.0, -1.0, 1.0)  # right, down, away
    place = dict(zip(gate.markers, corners, strict=True))
    sights = []
    for stamp, markers in seen:
        known = [(place[m.marker_id], m.corners) for m in markers if m.marker_id in place]
        if len(known) >= min(2, len(place)):
            points, pixels = (np.concatenate(part) for part in zip(*known, strict=True))
            sights.append(Sight(stamp, points, pixels))
    return sights


def mount_json(answer: MountAnswer) -> dict[str, Any]:
    """``answer`` for other programs; SI units but the angles of the settings."""
    found = answer.found
    return {
        "target": answer.target,
        "settings": answer.settings,
        "rotation_deviation": found.rotation_deviation.tolist(),
        "position_deviation": found.position_deviation.tolist(),
        "late": found.late,
        "late_deviation": found.late_deviation,
        "rms": found.rms,
        "images": found.sights,
        "shortfalls": list(found.shortfalls),
    }


def mount_lines(answer: MountAnswer) -> tuple[str, ...]:
    """``answer`` in words."""
    found = answer.found
    turned = Rotation.from_matrix(found.R_bc @ answer.before.R_bc.T).magnitude()
    moved = float(np.linalg.norm(found.p_bc - answer.before.p_bc))
    angles = ", ".join(f"{math.degrees(value):.3f}" for value in found.rotation_deviation)
    places = ", ".join(f"{1e3 * value:.1f}" for value in found.position_deviation)
    lines = [
        f"{found.sights} images of {answer.target}: {found.rms:.2f} px RMS",
        f"the camera is {math.degrees(turned):.2f}° and {1e3 * moved:.1f} mm from where it was configured",
        f"standard deviations: {angles}° about the body's x, y and z; {places} mm",
    ]
    late, deviation = found.late, found.late_deviation
    if abs(late) > 2.0 * deviation:
        latency, driver = (max(before + late, 0.0) for before in answer.late_before)
        lines.append(
            f"the camera's stamps are {1e3 * late:+.1f} ms ± {1e3 * deviation:.1f} ms late: set camera.latency ="
            f" {latency:.4f}, or camera.driver_delay = {driver:.4f} where the driver stamps"
        )
    else:
        lines.append(f"the camera's stamps fit the poses' within {1e3 * deviation:.1f} ms")
    lines += [f"set camera.{key} = {value}" for key, value in answer.settings.items()]
    return (*lines, *(f"not to be relied on: {text}" for text in found.shortfalls))
