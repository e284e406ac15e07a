"""Vehicle, tracker errors and gates estimated together.

One error-state filter (`process`, `correction`, `sighting`) over the vehicle's motion, what is wrong with the tracker,
with the accelerometer and with the camera's mount, and all gates, with their joint covariance, as in R. Smith,
M. Self and P. Cheeseman, "Estimating uncertain spatial relationships in robotics" (1990). Sightings arrive late: the
filter goes back to the exposure and repeats the steps since (`memory`).
"""

import math

import numpy as np

from flightapp.config import Config
from flightapp.estimation.alignment import Start, begin, relocate
from flightapp.estimation.correction import SILENCE
from flightapp.estimation.imu import REACH, ImuMemory
from flightapp.estimation.memory import StepMemory, coasted, pose_row
from flightapp.estimation.output import STATE, describe, gates_from_vehicle
from flightapp.estimation.process import (
    ATTITUDE,
    CORE,
    DRIFT,
    FELT,
    FORCE,
    GATE,
    POSITION,
    RATES,
    ROW,
    STAMP,
    VELOCITY,
    YAW,
    attitude,
)
from flightapp.estimation.settings import POSE_GATE, process_settings
from flightapp.estimation.sighting import more_upright, place, use_sighting
from flightapp.frames import Vector
from flightapp.mapping.absence import AbsenceWatch
from flightapp.mapping.register import GateRegister, hypotheses, prior_state
from flightapp.messages import (
    Drift,
    GateEstimate,
    GateMap,
    GateSighting,
    ImuSample,
    PoseSample,
    Sightings,
    VehicleState,
)
from flightapp.track import Track

AMBIGUITY = 4.0
"""χ² by which one of two poses must fit better for its yaw to be used."""
LEAST_POSITION_ERROR, LENS_ERROR, LENS_YAW_ERROR = 0.001, 0.0008, 0.0025
"""m at no distance, share of the distance, and rad of the gate's yaw: what remains wrong with sightings where errors of
mount and focal length are known, and changes as the gate moves through the image. As seen in rendered flights."""
MIRRORED_YAW = 0.5
"""rad, deviation of the yaw of a gate that was placed by a sighting with two explanations."""
SWAPPED, SWAPPED_YAW = 0.3, 0.2
"""m and rad, deviations of a gate from the place of another that is taken to be its own."""
NEAR = 0.3
"""m, nearer gates count as no nearer."""
STEADY = 1.5
"""rad/s, turning faster than that nothing is expected to be seen."""
UNBELIEVED = 20
"""Poses in a row that the filter did not believe, after which its own state is not to be trusted."""


class FusionEstimator:
    """The tracker's poses, the autopilot's inertial sensors and sightings of gates, fused.

    The world is where the tracker starts, as well as ``estimation.start_position`` and ``start_yaw`` say. Gates of the
    ``track`` that are unplaced are placed by their first sightings. Without poses the state coasts on the inertial
    sensors for ``estimation.coast`` seconds, and then there is none.
    """

    def __init__(self, config: Config, track: Track) -> None:
        e, m = config.estimation, config.mapping
        self._coast, self._trusted = e.coast, (e.trusted_sigma, e.trusted_speed)
        self._settings, self._start = process_settings(e, m), Start.of(e, m)
        self._sync_error = m.sync_error
        self._limits = np.array((m.gate, AMBIGUITY))
        self._register = GateRegister(config, track)
        size = CORE + GATE * len(self._register.gates)
        self._x, self._P = np.zeros(size), np.zeros((size, size))
        for i, gate in enumerate(track.passage):
            a = CORE + GATE * i
            self._x[a : a + GATE] = prior_state(gate)
            record = self._register.gates[i]
            if record.placed:
                self._P[range(a, a + GATE), range(a, a + GATE)] = np.square(record.deviations)
        self._memory, self._imu, self._watch = StepMemory(size), ImuMemory(), AbsenceWatch(config, track)
        self._epoch, self._version, self._unbelieved = 0, 0, 0
        self._posed = self._seen = -math.inf
        self._z = np.empty(4)

    def on_imu(self, sample: ImuSample) -> VehicleState | None:
        """Take ``sample`` over; the state at its stamp where poses have been silent for `SILENCE`, else None.

        Where the inertial sensors have been silent, too, they cannot stand in for poses: nothing tells of that time.
        """
        if not self._imu.add(sample) or self._memory.count == 0:
            return None
        if not SILENCE <= sample.stamp - self._posed <= self._coast or sample.stamp <= self._memory.newest[STAMP]:
            return None
        before = self._memory.newest
        felt = self._imu.felt(float(before[STAMP]), sample.stamp)
        if felt is None or (1.0 - felt[1]) * (sample.stamp - before[STAMP]) > REACH:
            return None
        row = np.empty(ROW)
        coasted(before, sample.stamp, sample.angular_velocity, *felt, row)
        self._memory.advance(row, self._x, self._P, self._settings)
        return self._state(row)

    def on_pose(self, sample: PoseSample) -> VehicleState | None:
        """The state at ``sample``'s stamp or, where the inertial sensors are ahead of it, at theirs.

        None where it is not newer than the pose before.
        """
        memory, ahead = self._memory, self._retreat(sample.stamp)
        if ahead is None:
            return None
        if memory.count == 0:
            begin(self._x, self._P, sample, self._start)
            row = _row(sample, None)
            memory.begin(row, self._x, self._P)
        else:
            before = float(memory.newest[STAMP])
            row = _row(sample, self._imu.felt(before, sample.stamp))
            if sample.epoch != self._epoch:
                q_wb = attitude(self._x, memory.newest[ATTITUDE : ATTITUDE + 4])
                relocate(self._x, self._P, q_wb, sample, sample.stamp - before)
            chi2 = memory.advance(row, self._x, self._P, self._settings)
            self._unbelieved = 0 if chi2 <= POSE_GATE else self._unbelieved + 1
            if sample.epoch != self._epoch:
                memory.begin(row, self._x, self._P)
        self._epoch, self._posed = sample.epoch, sample.stamp
        for step in ahead:
            row, felt = np.empty(ROW), (step[FORCE : FORCE + 3], float(step[FELT]))
            coasted(memory.newest, float(step[STAMP]), step[RATES : RATES + 3], *felt, row)
            memory.advance(row, self._x, self._P, self._settings)
        return self._state(row)

    def _retreat(self, stamp: float) -> list[Vector] | None:
        """Go back to before ``stamp``, where the inertial sensors are ahead of it; their steps after it.

        None where the last pose, or the last sighting that was used, was not before it.
        """
        if stamp <= self._posed:
            return None
        if self._memory.count == 0 or stamp > self._memory.newest[STAMP]:
            return []
        steps = self._memory.retreat(stamp, self._x, self._P, self._settings)
        return None if steps is None else [step for step in steps if step[STAMP] > stamp]

    def on_sightings(self, seen: Sightings) -> bool:
        """Use what was seen at ``seen.stamp``, which a pose or more should have passed; whether the map changed.

        Sightings that are older than `memory` reaches back, newer than the newest pose or out of order are not used.
        """
        if not (seen.stamp > self._seen and self._memory.reaches(seen.stamp)):
            return False
        self._seen = seen.stamp
        known = [(self._register.index[s.gate_id], s) for s in seen.gates if s.gate_id in self._register.index]
        missing = self._missing({s.gate_id for s in seen.gates})
        if not known:
            return missing
        row, following = self._memory.rewind(seen.stamp, self._x, self._P, self._settings)
        changed = [self._use(i, sighting, row) for i, sighting in known]
        self._memory.resume(row, following, self._x, self._P, self._settings)
        self._version += any(changed)
        return missing or any(changed)

    def _missing(self, seen: set[int]) -> bool:
        """Whether a gate is lost that should be in the frame in which those ``seen`` are."""
        row, register = self._memory.newest, self._register
        if float(np.linalg.norm(row[RATES : RATES + 3])) > STEADY:
            return False
        q_wb, lost = attitude(self._x, row[ATTITUDE : ATTITUDE + 4]), False
        for gate in self.gate_map(float(row[STAMP])).gates:
            i = register.index[gate.gate_id]
            record = register.gates[i]
            if self._watch.look(gate, gate.gate_id in seen, self._x[:3], q_wb) and (
                record.surveyed or record.sightings
            ):
                register.lost(i)
                lost = True
        self._version += lost
        return lost

    def _use(self, i: int, sighting: GateSighting, row: Vector) -> bool:
        """Correct the state with one sighting of the gate ``i`` from the step ``row``; whether anything changed."""
        register, at, stamp = self._register, CORE + GATE * i, float(row[STAMP])
        rows = hypotheses(sighting)
        if not all(map(math.isfinite, rows.flat)):
            return False
        record = register.gates[i]
        speed, turning = np.linalg.norm(self._x[VELOCITY : VELOCITY + 3]), np.linalg.norm(row[RATES : RATES + 3])
        distance = max(float(np.linalg.norm(rows[0, :3])), NEAR)
        lens = math.hypot(LEAST_POSITION_ERROR, LENS_ERROR * distance)
        repeats = register.repeats(i, stamp, float(turning + speed / distance))
        errors = np.array((self._sync_error, lens, LENS_YAW_ERROR)) * math.sqrt(repeats)
        if record.placed:
            verdict = use_sighting(self._x, self._P, at, row, rows, errors, self._limits, self._z)
            if verdict > 0:
                record.used(stamp)
            if verdict != 0:
                return verdict > 0
            anew = register.refused(i, stamp, self._x[POSITION : POSITION + 3] + self._z[:3])
        else:
            more_upright(self._x, row, rows, errors, self._z)
            anew = register.found(i, stamp, self._x[POSITION : POSITION + 3] + self._z[:3])
        if anew:
            self._place(i, rows, row, errors)
        return anew

    def _place(self, i: int, rows: Vector, row: Vector, errors: Vector) -> None:
        """Put the gate ``i`` where its sighting ``rows`` (1 or 2, 43) shows it, and where it was the one it ousts."""
        x, P, register, at = self._x, self._P, self._register, CORE + GATE * i
        chosen = more_upright(x, row, rows, errors, self._z)
        found, left = x[POSITION : POSITION + 3] + self._z[:3], x[at : at + 3].copy()
        gates = x[CORE:].reshape(-1, GATE)
        deviations = np.sqrt(P.diagonal()[CORE:].reshape(-1, GATE)[:, :2].max(axis=1))
        ousted = register.ousted(i, found, gates[:, :3], deviations)
        if ousted is not None:
            self._take_place(CORE + GATE * ousted, at)
        place(x, P, at, row, rows[chosen], errors)
        if len(rows) > 1:
            P[at + 3, at + 3] += MIRRORED_YAW**2
        register.placed_anew(i, float(row[STAMP]), found, left)
        if ousted is not None:
            register.swapped(i, ousted)

    def _take_place(self, to: int, at: int) -> None:
        """Let the gate in the state at ``to`` stand about where the one at ``at`` does."""
        x, P = self._x, self._P
        x[to : to + GATE] = x[at : at + GATE]
        P[to : to + GATE] = P[at : at + GATE]
        P[:, to : to + GATE] = P[:, at : at + GATE]
        P[range(to, to + GATE), range(to, to + GATE)] += np.square((SWAPPED, SWAPPED, SWAPPED, SWAPPED_YAW))

    def gate_map(self, stamp: float) -> GateMap:
        """The gates whose places are known, in order, and the tracker's drift, as they stand."""
        covariances = np.empty((len(self._register.gates), GATE, GATE))
        gates_from_vehicle(self._P, CORE, covariances)
        drift = self._P[DRIFT : YAW + 1, DRIFT : YAW + 1].copy()
        x, known = self._x[:CORE].copy(), float(self._memory.newest[STAMP]) if self._memory.count else stamp
        gates = self._gates(covariances)
        return GateMap(stamp, self._version, gates, Drift(known, x[DRIFT : DRIFT + 3], float(x[YAW]), drift))

    def places(self) -> tuple[GateEstimate, ...]:
        """The same gates with their covariances in the world, to be kept for another flight."""
        n = len(self._register.gates)
        blocks = self._P[CORE:, CORE:].reshape(n, GATE, n, GATE)
        return self._gates(blocks[range(n), :, range(n)])

    def _gates(self, covariances: Vector) -> tuple[GateEstimate, ...]:
        x = self._x.copy()
        places = x[CORE:].reshape(-1, GATE)
        return tuple(
            GateEstimate(
                gate.gate_id,
                place[:3],
                float(place[3]),
                covariance,
                gate.sightings,
                gate.last_seen,
                gate.surveyed,
            )
            for gate, place, covariance in zip(self._register.gates, places, covariances, strict=True)
            if gate.placed
        )

    def take_notices(self) -> tuple[str, ...]:
        """What there is to tell since the last call, in words."""
        notices, self._register.notices = tuple(self._register.notices), []
        return notices

    def _state(self, row: Vector) -> VehicleState:
        out = np.empty(STATE)
        describe(self._x, self._P, row, out)
        return VehicleState(
            float(row[STAMP]), out[0:3], out[3:7], out[7:10], out[10:13], out[13:].reshape(9, 9), self._doubt(out)
        )

    def _doubt(self, out: Vector) -> str:
        if self._unbelieved >= UNBELIEVED:
            return f"{self._unbelieved} poses in a row contradict the filter"
        variance = out[13::10]
        sigma, speed = math.sqrt(variance[:3].max()), math.sqrt(variance[3:6].max())
        if not sigma <= self._trusted[0]:
            return f"the position is known to {sigma:.2f} m"
        if not speed <= self._trusted[1]:
            return f"the velocity is known to {speed:.2f} m/s"
        return ""


def _row(sample: PoseSample, felt: tuple[Vector, float] | None) -> Vector:
    return pose_row(sample.stamp, sample.position, sample.orientation, sample.velocity, sample.angular_velocity, felt)
