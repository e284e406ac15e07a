import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from flightapp.config import Config, GateMapping
from flightapp.frames import Vector, quat_conjugate, quat_from_rotvec, quat_from_yaw, quat_multiply, quat_rotate
from flightapp.mapping.slam import (
    LEAST_POSITION_ERROR,
    LEAST_YAW_ERROR,
    START_POSITION,
    START_YAW,
    SlamMapper,
)
from flightapp.messages import GateMap, GateSighting, PoseSample
from flightapp.track import Gate, Start, Track, Uncertainty

WHITE = GateMapping(
    drift_speed=0.0,
    drift_speed_vertical=0.0,
    attitude_error=0.0,
    range_error=0.0,
    sync_error=0.0,
    correlation_time=0.0,
    gate=100.0,
)
UP = np.array((0.0, 0.0, 1.0))


def turned(yaw: float, v: Vector) -> Vector:
    return quat_rotate(quat_from_yaw(yaw), v)


def make_track(gates: list[tuple[float, float, float, float]], uncertainty: Uncertainty) -> Track:
    return Track(
        name="test",
        start=Start(position=(0.0, 0.0, 0.0)),
        gates=tuple(
            Gate(id=10 + i, position=(x, y, z), yaw_deg=math.degrees(yaw), markers=tuple(range(4 * i, 4 * i + 4)))
            for i, (x, y, z, yaw) in enumerate(gates)
        ),
        uncertainty=uncertainty,
    )


@dataclass
class World:
    """True gates (n, 4) and a tracker whose frame walks."""

    gates: Vector
    translation: Vector
    yaw: float
    rng: np.random.Generator

    def walk(self, position: Vector, dt: float, rate: float, yaw_rate: float) -> None:
        turn = yaw_rate * math.sqrt(dt) * self.rng.standard_normal()
        arm = position - self.translation
        self.translation = self.translation - turn * np.cross(UP, arm)
        self.translation = self.translation + rate * math.sqrt(dt) * self.rng.standard_normal(3)
        self.yaw += turn

    def pose(self, stamp: float, position: Vector, q_wb: Vector, velocity: Vector) -> PoseSample:
        back = quat_from_yaw(-self.yaw)
        return PoseSample(
            stamp,
            quat_rotate(back, position - self.translation),
            quat_multiply(back, q_wb),
            quat_rotate(back, velocity),
            np.zeros(3),
            3,
        )

    def sighting(
        self, stamp: float, i: int, position: Vector, q_wb: Vector, sigma: float, sigma_yaw: float
    ) -> GateSighting:
        covariance = np.diag([sigma**2] * 3 + [sigma_yaw**2] * 3)
        q_bw = quat_conjugate(q_wb)
        p_b = quat_rotate(q_bw, self.gates[i, :3] - position)
        q_bg = quat_multiply(q_bw, quat_from_yaw(self.gates[i, 3]))
        noise = math.hypot(sigma, LEAST_POSITION_ERROR) * self.rng.standard_normal(3)
        turn = math.hypot(sigma_yaw, LEAST_YAW_ERROR) * self.rng.standard_normal(3)
        q_seen = quat_multiply(q_bg, quat_from_rotvec(turn))
        return GateSighting(stamp, 10 + i, p_b + noise, q_seen, covariance, None, 4, 0.5)


def nees_of_flight(seed: int) -> float:
    """Squared error of the whole state, normalised by its covariance, after a flight past three gates."""
    rng = np.random.default_rng(seed)
    truth = np.array([(6.0, 1.0, 1.5, 0.2), (12.0, -1.0, 2.0, -0.2), (18.0, 0.5, 1.5, 0.0)])
    track = make_track(
        [(6, 0, 1.5, 0.0), (12, 0, 1.5, 0.0), (18, 0, 1.5, 0.0)], Uncertainty(horizontal=2.0, vertical=0.5)
    )
    config = Config(mapping=WHITE)
    mapper = SlamMapper(config, track, 0.0)
    prior = mapper.snapshot(0.0)
    for i, gate in enumerate(prior.gates):
        mean = np.array((*gate.position, gate.yaw))
        truth[i] = mean + np.linalg.cholesky(gate.covariance) @ rng.standard_normal(4)
    world = World(truth, START_POSITION * rng.standard_normal(3), START_YAW * rng.standard_normal(), rng)
    dt = 0.25
    for k in range(1, 36):
        position = np.array((0.5 * k, 0.3 * math.sin(0.2 * k), 1.5))
        world.walk(position, dt, config.mapping.drift_rate, config.mapping.drift_yaw_rate)
        q_wb = quat_from_rotvec(np.array((0.1, 0.15, 0.1 * math.sin(0.3 * k))))
        pose = world.pose(k * dt, position, q_wb, np.array((2.0, 0.0, 0.0)))
        seen = [i for i in range(3) if 0.5 < truth[i, 0] - position[0] < 4.0]
        mapper.update([world.sighting(k * dt, i, position, q_wb, 0.08, 0.1) for i in seen], pose)
    error = mapper._x - np.concatenate((world.translation, [world.yaw], truth.ravel()))
    error[3::4] = (error[3::4] + math.pi) % (2 * math.pi) - math.pi
    return float(error @ np.linalg.solve(mapper._P, error))


def test_the_joint_covariance_is_consistent() -> None:
    runs, states = 60, 16
    mean = float(np.mean([nees_of_flight(seed) for seed in range(runs)]))
    low, high = chi2.ppf((0.025, 0.975), runs * states) / runs
    assert low < mean < high


def approach(
    mapper: SlamMapper,
    world: World,
    i: int,
    start: float,
    frames: int = 60,
    sigma: float = 0.03,
    sigma_yaw: float = 0.05,
) -> GateMap:
    """Fly from 6 m before gate ``i`` to 1.5 m before it at 30 Hz."""
    latest = mapper.snapshot(start)
    for k in range(frames):
        stamp = start + k / 30.0
        before = 6.0 - 4.5 * k / max(frames - 1, 1)
        position = world.gates[i, :3] - turned(world.gates[i, 3], np.array((before, 0.2, 0.1)))
        q_wb = quat_from_yaw(world.gates[i, 3])
        velocity = turned(world.gates[i, 3], np.array((4.5 * 30 / frames if frames > 1 else 0.0, 0.0, 0.0)))
        latest = mapper.update(
            [world.sighting(stamp, i, position, q_wb, sigma, sigma_yaw)], world.pose(stamp, position, q_wb, velocity)
        )
    return latest


@pytest.mark.parametrize("seed", range(5))
def test_a_gate_known_within_three_metres_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0, 2 * math.pi)
    off = 3.0 * np.array((math.cos(heading), math.sin(heading), 0.0)) + np.array((0.0, 0.0, 0.5 * rng.uniform(-1, 1)))
    truth = np.array([(8.0, 2.0, 2.0, 0.3)])
    prior = (*(truth[0, :3] + off), 0.3 + math.radians(10.0) * rng.uniform(-1, 1))
    track = make_track([prior], Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0))
    mapper = SlamMapper(Config(), track, 0.0)
    latest = approach(mapper, World(truth, np.zeros(3), 0.0, rng), 0, 0.1)
    gate = latest.gates[0]
    error = np.append(gate.position, gate.yaw) - truth[0]
    assert np.linalg.norm(error[:3]) < 0.1
    assert abs(error[3]) < 0.06
    assert gate.sightings == 60
    assert gate.last_seen == pytest.approx(0.1 + 59 / 30)
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(gate.covariance)))


def test_a_known_gate_reveals_the_drift() -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.0), (16.0, 0.0, 1.5, 0.0)])
    mapper = SlamMapper(Config(), make_track([tuple(g) for g in truth], Uncertainty()), 0.0)
    world = World(truth, np.array((0.25, -0.2, 0.3)), 0.03, np.random.default_rng(1))
    latest = approach(mapper, world, 0, 20.0)
    position = truth[0, :3] - (1.5, 0.2, 0.1)
    pose = world.pose(22.0, position, quat_from_yaw(0.0), np.zeros(3))
    recovered = turned(latest.drift.yaw, pose.position) + latest.drift.translation
    assert np.linalg.norm(recovered - position) < 0.06
    assert np.linalg.norm(latest.gates[0].position - truth[0, :3]) < 0.03


def stare(mapper: SlamMapper, world: World, i: int, start: float, bias: Vector | None = None) -> GateMap:
    """Hover at the origin and look at gate ``i`` for a second; ``bias`` (3,) turns what is seen, rad."""
    latest = mapper.snapshot(start)
    q_wb, position = quat_from_yaw(0.0), np.zeros(3)
    turn = quat_from_rotvec(np.zeros(3) if bias is None else bias)
    for k in range(30):
        stamp = start + k / 30.0
        s = world.sighting(stamp, i, position, q_wb, 0.02, 0.03)
        seen = replace(s, position=quat_rotate(turn, s.position))
        latest = mapper.update([seen], world.pose(stamp, position, q_wb, np.zeros(3)))
    return latest


def test_gates_and_drift_are_correlated() -> None:
    """A gate met again tells the drift, and so corrects one that was mapped since and is out of sight."""
    truth = np.array([(4.0, 0.0, 1.5, 0.0), (4.0, 3.0, 1.5, 0.0)])
    prior = [(4.5, 0.5, 1.5, 0.0), (4.0, 4.0, 1.5, 0.0)]
    mapper = SlamMapper(Config(), make_track(prior, Uncertainty(horizontal=3.0)), 0.0)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(2))
    stare(mapper, world, 0, 0.1)
    world.translation = np.array((0.0, 0.25, 0.0))
    before = stare(mapper, world, 1, 20.0).gates[1]
    after = stare(mapper, world, 0, 21.0).gates[1]
    assert abs(before.position[1] - truth[1, 1]) > 0.2
    assert abs(after.position[1] - truth[1, 1]) < 0.1
    assert after.covariance[1, 1] < before.covariance[1, 1]


def test_a_moved_gate_is_learnt_anew() -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.0), (16.0, 0.0, 1.5, 0.0)])
    mapper = SlamMapper(Config(), make_track([tuple(g) for g in truth], Uncertainty(horizontal=1.0)), 0.0)
    world = World(truth.copy(), np.zeros(3), 0.0, np.random.default_rng(3))
    approach(mapper, world, 0, 0.1)
    world.gates[0, :2] += (1.0, 2.5)
    moved = approach(mapper, world, 0, 20.0)
    assert np.linalg.norm(moved.gates[0].position - world.gates[0, :3]) < 0.1
    assert np.linalg.norm(moved.gates[1].position - truth[1, :3]) < 0.05
    assert np.linalg.norm(moved.drift.translation) < 0.1


def test_single_outliers_are_refused() -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.0)])
    config = Config()
    mapper = SlamMapper(config, make_track([tuple(truth[0])], Uncertainty(horizontal=1.0)), 0.0)
    world = World(truth.copy(), np.zeros(3), 0.0, np.random.default_rng(4))
    known = approach(mapper, world, 0, 0.1)
    world.gates[0, 1] += 3.0
    for _ in range(config.mapping.moved_after - 1):
        after = approach(mapper, world, 0, 20.0, frames=1)
    assert after.version == known.version
    assert np.array_equal(after.gates[0].position, known.gates[0].position)


def mirrored(sighting: GateSighting) -> Vector:
    """The other pose of an ambiguous square: its normal mirrored about the line of sight."""
    line = sighting.position / np.linalg.norm(sighting.position)
    normal = quat_rotate(sighting.orientation, np.array((1.0, 0.0, 0.0)))
    other = 2.0 * (normal @ line) * line - normal
    axis = np.cross(normal, other)
    sine, cosine = float(np.linalg.norm(axis)), float(normal @ other)
    return quat_multiply(quat_from_rotvec(axis / max(sine, 1e-12) * math.atan2(sine, cosine)), sighting.orientation)


@pytest.mark.parametrize("wrong_first", [False, True])
def test_ambiguous_sightings_do_not_flip_the_yaw(wrong_first: bool) -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.35)])
    track = make_track([(7.0, 1.0, 1.5, 0.25)], Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0))
    mapper = SlamMapper(Config(), track, 0.0)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(5))
    for k in range(60):
        position, q_wb = np.array((2.0 + 0.07 * k, 0.0, 1.5)), quat_from_yaw(0.0)
        s = world.sighting(0.1 + k / 30, 0, position, q_wb, 0.03, 0.05)
        pair = ((s.position, s.orientation), (s.position, mirrored(s)))
        first, second = pair[::-1] if wrong_first else pair
        ambiguous = GateSighting(s.stamp, 10, first[0], first[1], s.covariance, second, 1, 0.5)
        latest = mapper.update([ambiguous], world.pose(s.stamp, position, q_wb, np.array((2.1, 0.0, 0.0))))
    assert abs(latest.gates[0].yaw - 0.35) < 0.06
    assert np.linalg.norm(latest.gates[0].position - truth[0, :3]) < 0.1


def test_undecided_sightings_leave_the_yaw_alone() -> None:
    truth = np.array([(6.0, 0.0, 1.5, 0.0)])
    track = make_track([tuple(truth[0])], Uncertainty(horizontal=3.0, yaw_deg=30.0))
    mapper = SlamMapper(Config(), track, 0.0)
    prior = mapper.snapshot(0.0).gates[0]
    q_wb = quat_from_yaw(0.0)
    s = World(truth, np.zeros(3), 0.0, np.random.default_rng(6)).sighting(0.1, 0, np.zeros(3), q_wb, 0.03, 0.05)
    first, second = quat_from_yaw(0.3), quat_from_yaw(-0.3)
    ambiguous = GateSighting(0.1, 10, s.position, first, s.covariance, (s.position, second), 1, 0.5)
    pose = PoseSample(0.1, np.zeros(3), q_wb, np.zeros(3), np.zeros(3), 3)
    after = mapper.update([ambiguous], pose).gates[0]
    assert after.covariance[0, 0] < 0.1 * prior.covariance[0, 0]
    assert after.yaw == pytest.approx(prior.yaw, abs=1e-3)
    assert after.covariance[3, 3] == pytest.approx(prior.covariance[3, 3], rel=1e-3)


def test_standing_before_a_gate_does_not_make_it_perfectly_known() -> None:
    """The mount's error is the same in every frame, so the map must not believe to average it out."""
    truth = np.array([(6.0, 0.0, 1.5, 0.0)])
    mapper = SlamMapper(Config(), make_track([(6.5, 0.5, 1.5, 0.0)], Uncertainty(horizontal=3.0)), 0.0)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(7))
    for start in range(3):
        latest = stare(mapper, world, 0, 0.1 + start, np.array((0.0, 0.008, 0.008)))
    error = latest.gates[0].position - truth[0, :3]
    deviations = np.sqrt(np.diag(latest.gates[0].covariance)[:3])
    assert np.all(np.abs(error) < 3.0 * deviations)
    assert np.all(deviations < 0.1)


def test_a_relocalising_tracker_reopens_the_drift() -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.0)])
    mapper = SlamMapper(Config(), make_track([tuple(truth[0])], Uncertainty()), 0.0)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(8))
    approach(mapper, world, 0, 0.1, frames=20)
    world.translation = np.array((0.0, 1.5, 0.0))
    position = truth[0, :3] - (3.0, 0.0, 0.0)
    q_wb = quat_from_yaw(0.0)
    for k in range(10):
        stamp = 0.8 + k / 30
        latest = mapper.update(
            [world.sighting(stamp, 0, position, q_wb, 0.02, 0.05)], world.pose(stamp, position, q_wb, np.zeros(3))
        )
    assert np.linalg.norm(latest.gates[0].position - truth[0, :3]) < 0.1
    assert np.linalg.norm(latest.drift.translation - world.translation) < 0.1


def test_versions_and_snapshots() -> None:
    truth = np.array([(8.0, 0.0, 1.5, 0.0)])
    mapper = SlamMapper(Config(), make_track([tuple(truth[0])], Uncertainty(horizontal=1.0)), 2.0)
    first = mapper.snapshot(3.0)
    assert (first.stamp, first.version, first.gates[0].gate_id, first.gates[0].sightings) == (3.0, 0, 10, 0)
    assert first.gates[0].last_seen == -math.inf
    assert first.gates[0].covariance[0, 0] == pytest.approx(0.25)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(9))
    second = approach(mapper, world, 0, 4.0, frames=3)
    assert second.version == 3
    empty = mapper.update([], world.pose(5.0, np.zeros(3), quat_from_yaw(0.0), np.zeros(3)))
    assert (empty.stamp, empty.version) == (5.0, 3)
    assert empty.drift.covariance[0, 0] > second.drift.covariance[0, 0]
    kept = second.gates[0].position.copy()
    approach(mapper, world, 0, 6.0, frames=3)
    assert np.array_equal(second.gates[0].position, kept)


numbers = st.floats(-1e6, 1e6) | st.sampled_from((math.nan, math.inf, 0.0))
anywhere = st.tuples(numbers, numbers, numbers).map(np.array)
positions = st.lists(st.floats(-30.0, 30.0), min_size=3, max_size=3).map(np.array)
turns = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(lambda r: quat_from_rotvec(np.array(r)))
covariances = st.floats(1e-4, 3.0).map(lambda sigma: sigma**2 * np.eye(6)) | st.lists(
    st.floats(-1.0, 1.0), min_size=36, max_size=36
).map(lambda entries: np.reshape(entries, (6, 6)))


@st.composite
def observations(draw: st.DrawFn) -> tuple[GateSighting, PoseSample]:
    stamp = draw(st.floats(0.0, 100.0))
    gate_id = draw(st.sampled_from((10, 11, 99)))
    position = draw(positions | anywhere)
    alternative = draw(st.none() | st.tuples(positions, turns))
    sighting = GateSighting(stamp, gate_id, position, draw(turns), draw(covariances), alternative, 1, 1.0)
    pose = PoseSample(stamp, draw(positions), draw(turns), draw(positions), draw(positions), 3)
    return sighting, pose


@settings(max_examples=60, deadline=None)
@given(st.lists(observations(), max_size=25))
def test_the_map_never_diverges(stream: list[tuple[GateSighting, PoseSample]]) -> None:
    """Whatever comes in: all stays finite, the covariance positive, and no drift larger than what was seen."""
    track = make_track([(5, 0, 1.5, 0.0), (10, 3, 2.0, 1.0)], Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0))
    mapper = SlamMapper(Config(), track, 0.0)
    for sighting, pose in stream:
        latest = mapper.update([sighting], pose)
        assert np.isfinite(mapper._x).all()
        assert np.isfinite(mapper._P).all()
        assert np.array_equal(mapper._P, mapper._P.T)
        assert np.linalg.eigvalsh(mapper._P)[0] > -1e-9
        assert all(np.all(np.diag(gate.covariance) > 0.0) for gate in latest.gates)


@pytest.mark.benchmark(group="mapping")
def test_map_update_speed(benchmark: object) -> None:
    truth = np.array([(8.0 * i, 0.0, 1.5, 0.0) for i in range(1, 6)])
    mapper = SlamMapper(Config(), make_track([tuple(g) for g in truth], Uncertainty(horizontal=1.0)), 0.0)
    world = World(truth, np.zeros(3), 0.0, np.random.default_rng(10))
    latest = approach(mapper, world, 0, 0.1)
    position, q_wb = truth[0, :3] - (3.0, 0.0, 0.0), quat_from_yaw(0.0)
    seen = [world.sighting(3.0, i, position, q_wb, 0.03, 0.05) for i in (0, 1)]
    pose = world.pose(3.0, position, q_wb, np.zeros(3))
    after = benchmark(mapper.update, seen, pose)  # type: ignore[operator]
    assert after.version > latest.version
