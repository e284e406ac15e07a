"""Faults of the sensors and of the gates in a world in the same process, from sim.faults: (s, name, value).

The time is that of the flight's clock, which starts at 0 when the world is made; a sample or an image is affected by
the time at which it was captured. What lasts, lasts to the end of the flight where no duration is given.

| fault             | value         | what happens                                                                  |
| ----------------- | ------------- | ----------------------------------------------------------------------------- |
| pose_silent       | s             | the tracker measures nothing                                                  |
| pose_jump         | m             | poses for `JUMP_TIME` are off by as much, along their frame's x               |
| pose_relocalised  | m or m:deg    | the tracker's frame moves (along its x) and turns (about the vehicle)         |
| pose_frozen       | s             | the tracker tells the same pose again and again, with new stamps              |
| camera_frozen     | s             | the camera delivers the same image again and again, with new stamps           |
| camera_black      | s             | its images are black                                                          |
| camera_slow       | Hz            | images come no more often                                                     |
| camera_late       | s             | images come later by as much                                                  |
| sightings_wrong   | share         | of the images are as if taken from another place (`ASIDE`, `TURNED`)          |
| calibration_wrong | share         | the focal length is believed to be greater by as much; from the start         |
| gate_missing      | id            | the gate does not stand; from the start                                       |
| gate_moved        | id:m          | the gate moves to the left of its direction of passage, or right if negative  |
| gates_swapped     | id:id         | two gates change places                                                       |

What flight code shall do about it:

| fault                       | reaction                                                                               |
| --------------------------- | -------------------------------------------------------------------------------------- |
| pose_silent, pose_frozen    | coasts for estimation.coast and flies on where poses are back by then; else it hands   |
|                             | over to the autopilot, which lands                                                     |
| pose_jump, pose_relocalised | flies on; nothing else is visible                                                      |
| camera_frozen, camera_black | flies on through gates that are known; stops before others, or where a gate ought to   |
|                             | be in sight, searches, and lands when race.search_timeout is over: WRONG_PROGRESS      |
| camera_slow, camera_late    | flies on                                                                               |
| sightings_wrong             | flies on: what contradicts the map is not used                                         |
| calibration_wrong           | flies on, off the gates' centres                                                       |
| gate_missing                | searches for it, and lands when race.search_timeout is over: WRONG_PROGRESS            |
| gate_moved                  | says so, learns the new place and flies through there                                  |
| gates_swapped               | says so as soon as one is seen in the other's place, takes the other to be in its own, |
|                             | and flies through all in their order                                                   |
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from flightapp.frames import Vector, quat_from_yaw, quat_multiply, quat_rotate
from flightapp.inputs import BadInputError
from flightapp.messages import Frame, PoseSample
from flightapp.track import Track
from sim.fault_values import Value, number, pair, seconds, share, unknown
from sim.render import PoseAt

JUMP_TIME = 0.03
"""s, of a jump that comes back."""
ASIDE = (0.5, 3.0)
"""m to any side, and up to a quarter of it up or down, of the place from which a wrong image seems to be taken."""
TURNED = 0.2
"""rad to any side, by which it seems to be turned."""
LATEST = 0.4
"""s, greatest additional latency of the camera."""

Amount = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault from ``begin`` to before ``end`` (s of the flight's clock); ``amount`` is its value."""

    begin: float
    end: float
    name: str
    amount: Amount

    def acts(self, stamp: float) -> bool:
        """Whether it does so at ``stamp``."""
        return self.begin <= stamp < self.end


def _duration(value: Value) -> Amount:
    return (seconds(value),)


def _one(value: Value) -> Amount:
    return (number(value),)


def _rate(value: Value) -> Amount:
    if (read := number(value)) <= 0.0:
        raise ValueError(f"a rate is more than 0 Hz, not {read:g}")
    return (read,)


def _lateness(value: Value) -> Amount:
    if (read := seconds(value)) > LATEST:
        raise ValueError(f"at most {LATEST} s, not {read:g}")
    return (read,)


def _relative(value: Value) -> Amount:
    if abs(read := number(value)) > 0.5:
        raise ValueError(f"at most 0.5 more or less, not {read:g}")
    return (read,)


def _move_and_turn(value: Value) -> Amount:
    return pair(value) if isinstance(value, str) and ":" in value else (number(value), 0.0)


SENSOR_FAULTS: Mapping[str, Callable[[Value], Amount]] = MappingProxyType(
    {
        "pose_silent": _duration,
        "pose_jump": _one,
        "pose_relocalised": _move_and_turn,
        "pose_frozen": _duration,
        "camera_frozen": _duration,
        "camera_black": _duration,
        "camera_slow": _rate,
        "camera_late": _lateness,
        "sightings_wrong": lambda value: (share(value),),
        "calibration_wrong": _relative,
        "gate_missing": _one,
        "gate_moved": pair,
        "gates_swapped": pair,
    }
)
"""All faults that there are, by name, with what reads their values."""
LASTING = {"pose_silent", "pose_frozen", "camera_frozen", "camera_black"}
"""Faults whose value is their duration."""
FROM_START = {"calibration_wrong", "gate_missing"}
"""Faults that are there from the start or not at all."""


def read_faults(entries: Sequence[tuple[float, str, float | str]]) -> tuple[Fault, ...]:
    """The faults that sim.faults tells, in the order of their times; raises `BadInputError`."""
    return tuple(sorted((_read(*entry) for entry in entries), key=lambda fault: fault.begin))


def _read(begin: float, name: str, value: float | str) -> Fault:
    if name not in SENSOR_FAULTS:
        other = "faults of the link and of the vehicle behind it need --sim --mavlink"
        raise BadInputError(f"{unknown(name, SENSOR_FAULTS)}; {other}")
    try:
        amount = SENSOR_FAULTS[name](value)
    except ValueError as error:
        raise BadInputError(f"fault '{name}': {error}") from None
    if name in FROM_START and begin > 0.0:
        raise BadInputError(f"fault '{name}' is there from the start: its time must be 0, not {begin:g}")
    duration = amount[0] if name in LASTING else JUMP_TIME if name == "pose_jump" else math.inf
    return Fault(begin, begin + duration, name, amount)


class PoseFaults:
    """What becomes of a tracker's samples."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = tuple(fault for fault in faults if fault.name.startswith("pose_"))
        self._places: dict[Fault, Vector] = {}
        self._last: PoseSample | None = None

    def apply(self, sample: PoseSample) -> PoseSample | None:
        """What the tracker tells instead of ``sample``; None for nothing."""
        acting = [fault for fault in self._faults if fault.acts(sample.stamp)]
        for fault in acting:
            if fault.name == "pose_relocalised":
                sample = self._relocalised(fault, sample)
            elif fault.name == "pose_jump":
                sample = replace(sample, position=sample.position + np.array((fault.amount[0], 0.0, 0.0)))
            elif fault.name == "pose_frozen" and self._last is not None:
                sample = replace(self._last, stamp=sample.stamp)
        self._last = sample
        return None if any(fault.name == "pose_silent" for fault in acting) else sample

    def _relocalised(self, fault: Fault, sample: PoseSample) -> PoseSample:
        centre = self._places.setdefault(fault, sample.position)
        way, turn = fault.amount
        q = quat_from_yaw(math.radians(turn))
        push = sample.acceleration
        return replace(
            sample,
            position=centre + quat_rotate(q, sample.position - centre) + np.array((way, 0.0, 0.0)),
            orientation=quat_multiply(q, sample.orientation),
            velocity=quat_rotate(q, sample.velocity),
            acceleration=None if push is None else quat_rotate(q, push),
        )


class CameraFaults:
    """What becomes of a camera's images; ``seed`` decides which are wrong, and how."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._faults = tuple(fault for fault in faults if fault.name in CAMERA)
        self._random = np.random.default_rng(seed)
        self._last: Frame | None = None
        self.focal = 1.0 + sum(fault.amount[0] for fault in faults if fault.name == "calibration_wrong")
        """Focal length that is believed, over the true one."""

    def lateness(self, stamp: float) -> float:
        """s by which an image of ``stamp`` comes later."""
        return max((fault.amount[0] for fault in self._acting(stamp, "camera_late")), default=0.0)

    def expose(self, stamp: float, pose_at: PoseAt, take: Callable[[PoseAt], Frame]) -> Frame | None:
        """The image of ``stamp``, which ``take`` takes from where the camera is; None where there is none."""
        for slow in self._acting(stamp, "camera_slow"):
            if self._last is not None and stamp - self._last.stamp < 1.0 / slow.amount[0] - 1e-6:
                return None
        for wrong in self._acting(stamp, "sightings_wrong"):
            if self._random.random() < wrong.amount[0]:
                pose_at = self._elsewhere(pose_at)
        frame = take(pose_at)
        if self._last is not None and self._acting(stamp, "camera_frozen"):
            frame = replace(self._last, stamp=stamp, sequence=frame.sequence)
        elif self._acting(stamp, "camera_black"):
            image = None if frame.image is None else np.zeros_like(frame.image)
            frame = replace(frame, image=image, markers=())
        self._last = frame
        return frame

    def _acting(self, stamp: float, name: str) -> list[Fault]:
        return [fault for fault in self._faults if fault.name == name and fault.acts(stamp)]

    def _elsewhere(self, pose_at: PoseAt) -> PoseAt:
        way, bearing = self._random.uniform(*ASIDE), self._random.uniform(-math.pi, math.pi)
        up, turn = self._random.uniform(-0.25, 0.25) * way, self._random.uniform(-TURNED, TURNED)
        aside = np.array((way * math.cos(bearing), way * math.sin(bearing), up))
        q = quat_from_yaw(turn)

        def elsewhere(stamp: float) -> tuple[Vector, Vector]:
            position, orientation = pose_at(stamp)
            return position + aside, quat_multiply(q, orientation)

        return elsewhere


CAMERA = {"camera_frozen", "camera_black", "camera_slow", "camera_late", "sightings_wrong"}
"""Faults of which `CameraFaults` asks when an image is taken."""


def rearranged(track: Track, faults: Sequence[Fault]) -> tuple[tuple[float, Track], ...]:
    """How the gates of ``track`` really stand from which time on, the first at the start.

    Raises `BadInputError` for a gate that the track does not have.
    """
    now, later = track, []
    for fault in faults:
        if fault.name not in ("gate_missing", "gate_moved", "gates_swapped"):
            continue
        now = _rearranged(now, fault)
        if fault.begin <= 0.0:
            track = now
        else:
            later.append((fault.begin, now))
    return (0.0, track), *later


def _rearranged(track: Track, fault: Fault) -> Track:
    gates = {gate.id: gate for gate in track.gates}
    named = fault.amount if fault.name == "gates_swapped" else fault.amount[:1]
    for gate_id in named:
        if gate_id not in gates:
            raise BadInputError(f"fault '{fault.name}': the track has no gate {gate_id:g}")
    first = gates[int(named[0])]
    if fault.name == "gate_missing":
        del gates[first.id]
    elif fault.name == "gate_moved":
        (x, y, z), way = first.position, fault.amount[1]
        place = (x - way * math.sin(first.yaw), y + way * math.cos(first.yaw), z)
        gates[first.id] = first.model_copy(update={"position": place})
    else:
        second = gates[int(named[1])]
        for gate, other in ((first, second), (second, first)):
            gates[gate.id] = gate.model_copy(update={"position": other.position, "yaw_deg": other.yaw_deg})
    return track.model_copy(update={"gates": tuple(gates.values())})
