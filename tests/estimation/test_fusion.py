import numpy as np
import pytest
from fusion_world import GATES, Circling, a_track
from scipy.stats import chi2

from flightapp.config import Config, GateMapping, load_config
from flightapp.estimation.fusion import FusionEstimator
from flightapp.frames import quat_from_yaw, quat_multiply, quat_rotate, quat_yaw, wrap_angle
from flightapp.messages import GateSighting, PoseSample, Sightings

WHITE = Config(
    mapping=GateMapping(
        attitude_error=0.0, range_error=0.0, sync_error=0.0, correlation_time=0.0, same_view=0.0, gate=100.0
    )
)
"""Sightings whose errors are all their own."""
TURNED = Config(
    mapping=GateMapping(
        attitude_error=0.01, range_error=0.0, sync_error=0.0, correlation_time=0.0, same_view=0.0, gate=100.0
    )
)
"""Sightings by a camera that is mounted a little otherwise than is believed."""


def flown(world, estimator, seconds, frames=6, gates=(), late=0.03, imu=True):
    """Fly on; every ``frames`` poses the ``gates`` are seen ``late`` s before; the states."""
    states = []
    for count in range(int(seconds * 200)):
        pose, felt = world.advance()
        if imu:
            estimator.on_imu(felt)
        state = estimator.on_pose(pose)
        assert state is not None
        states.append(state)
        if gates and count % frames == 0:
            estimator.on_sightings(world.seen(world.stamp - late, gates))
    return states


def position_error(world, state):
    return state.position - world.motion(state.stamp)[0]


def test_without_gates_the_state_follows_the_tracker():
    world = Circling(seed=1)
    states = flown(world, FusionEstimator(WHITE, a_track()), 3.0)
    for state in states[::50]:
        assert np.linalg.norm(position_error(world, state)) < 0.25
        assert state.doubt == ""


def test_without_gates_and_with_a_perfect_tracker_the_state_stays_at_its_pose():
    """Inertial sensors, as noisy as they are, tell little of what may be wrong with it but for its height."""
    world = Circling(seed=3)
    faultless = {"drift_walk": 0.0, "drift_at_rest": 1e-9, "yaw_walk": 0.0, "yaw_at_rest": 1e-9, "slip_across": 0.0}
    faultless |= {"slip_up": 0.0, "tilt_error": 1e-9, "scale_error": 1e-9, "start_yaw": 1e-9, "start_position": 1e-9}
    world.config = world.config.model_copy(update={"estimation": world.config.estimation.model_copy(update=faultless)})
    world.__post_init__()
    world.mount = np.array((1.0, 0.0, 0.0, 0.0))
    for state in flown(world, FusionEstimator(Config(), a_track()), 20.0)[::100]:
        error, sigma = position_error(world, state), np.sqrt(np.diag(state.covariance)[:3])
        # An estimate that followed the noise of its sensors would be off by about a sigma.
        assert np.linalg.norm(error[:2]) < 0.5 * np.linalg.norm(sigma[:2]) + 0.01
        assert abs(error[2]) < 3.0 * sigma[2] + 0.01


@pytest.mark.parametrize("seed", [7, 8])
def test_poses_tell_nothing_of_the_heading(seed):
    """However the estimate moves, the heading becomes the less known the further the vehicle has flown."""
    config, world = Config(), Circling(seed=seed)
    e = config.estimation
    states = flown(world, FusionEstimator(config, a_track()), 15.0)
    way = sum(float(np.linalg.norm(world.motion(state.stamp)[1])) for state in states) / 200.0
    walked = e.start_yaw**2 + e.yaw_walk**2 * way + e.yaw_at_rest**2 * world.stamp
    sigmas = np.sqrt([state.covariance[8, 8] for state in states])
    assert sigmas[-1] == pytest.approx(np.sqrt(walked), rel=0.05)
    assert (np.diff(sigmas) > -1e-5).all()


def test_what_is_seen_again_and_again_from_one_place_tells_little_more():
    """Nothing moves, so the same is wrong with each sighting: forty tell no more than a few."""
    estimator, rest, sigmas = FusionEstimator(Config(), a_track()), np.zeros(3), []
    still = np.array((1.0, 0.0, 0.0, 0.0))
    for count in range(400):
        stamp = 0.005 * count
        estimator.on_pose(PoseSample(stamp, rest, still, rest, rest, 3))
        if count % 6 == 1:
            seen = GateSighting(stamp, 1, np.array((8.0, 0.0, 1.5)), still, 1e-4 * np.eye(6), None, 4, 0.1)
            estimator.on_sightings(Sightings(stamp - 0.003, count, (), (seen,)))
            sigmas.append(float(np.sqrt(estimator.gate_map(stamp).gates[0].covariance[3, 3])))
    assert sigmas[0] < 0.02
    assert sigmas[-1] > 0.5 * sigmas[0]


@pytest.mark.parametrize(
    "config", [pytest.param(WHITE, marks=pytest.mark.soak), TURNED], ids=["perfect mount", "wrong mount"]
)
def test_errors_are_as_large_as_the_filter_says(config):
    """NEES of position, velocity and heading over flights drawn from the filter's own model.

    Gates of 3 m priors are seen, and then none.
    """
    runs, totals, told = 30, [], [*range(6), 8]
    for seed in range(runs):
        world = Circling(config, seed)
        draw = np.random.default_rng(1000 + seed)
        angle, radius = draw.uniform(0.0, 2.0 * np.pi, 3), 3.0 * np.sqrt(draw.uniform(size=3))
        offsets = {
            i: np.array((r * np.cos(a), r * np.sin(a), draw.uniform(-0.5, 0.5)))
            for i, a, r in zip(GATES, angle, radius, strict=True)
        }
        estimator = FusionEstimator(config, a_track(offsets))
        flown(world, estimator, 4.0, gates=(1, 2, 3))
        state = flown(world, estimator, 4.0)[-1]
        p, v, _, q, _ = world.motion(state.stamp)
        heading = wrap_angle(float(quat_yaw(state.orientation)) - float(quat_yaw(q)))
        e = np.concatenate((state.position - p, state.velocity - v, [heading]))
        totals.append(float(e @ np.linalg.solve(state.covariance[np.ix_(told, told)], e)))
    low, high = chi2.ppf((0.005, 0.995), len(told) * runs) / runs
    assert low < np.mean(totals) < high


def circled(seed):
    """m by which position and tracker are off in the end, and the gates; for one that sees and one that doesn't."""
    world = Circling(seed=seed)
    offsets = {1: np.array((1.0, -1.0, 0.3)), 2: np.array((-2.0, 0.5, 0.2)), 3: np.array((0.3, 2.0, -0.4))}
    seeing, blind = FusionEstimator(Config(), a_track(offsets)), FusionEstimator(Config(), a_track(offsets))
    for count in range(4000):
        pose, felt = world.advance()
        for estimator in (seeing, blind):
            estimator.on_imu(felt)
            state = estimator.on_pose(pose)
            assert state is not None
        if count % 6 == 0:
            seeing.on_sightings(world.seen(world.stamp - 0.03, (1, 2, 3)))
    truth = world.motion(world.stamp)[0]
    raw = quat_rotate(quat_from_yaw(0.0), pose.position)
    final = seeing.on_pose(world.advance()[0])
    assert final is not None
    off = np.linalg.norm(final.position - world.motion(world.stamp)[0])
    return off, np.linalg.norm(raw - truth), seeing.gate_map(world.stamp).gates, blind.gate_map(0.0).gates


def test_gates_are_found_and_hold_the_tracker_to_the_world():
    """In some worlds the tracker happens to be hardly off in the end."""
    flights = [circled(seed) for seed in range(4, 8)]
    off, tracker_off, found, unseen = zip(*flights, strict=True)
    assert np.sum(np.square(off)) < 0.25**2 * np.sum(np.square(tracker_off))
    for gate in (gate for gates in found for gate in gates):
        assert np.linalg.norm(gate.position - GATES[gate.gate_id][:3]) < 0.15
        assert gate.sightings > 100
    assert [gate.sightings for gates in unseen for gate in gates] == [0] * 12


@pytest.mark.parametrize("every", [7, 2])
def test_a_late_sighting_counts_as_if_it_had_come_at_once(every):
    """The same sightings, 5 ms and 100 ms after their exposure, lead to the same state."""
    ends = []
    for late in (1, 20):
        world = Circling(seed=5)
        estimator = FusionEstimator(Config(), a_track({1: np.array((1.0, 0.5, 0.2))}))
        waiting = []
        for count in range(800):
            pose, felt = world.advance()
            estimator.on_imu(felt)
            state = estimator.on_pose(pose)
            if count % every == every - 1 and count < 700:
                waiting.append((count + late, world.seen(world.stamp - 0.003, (1,))))
            if waiting and waiting[0][0] == count:
                assert estimator.on_sightings(waiting.pop(0)[1])
        assert state is not None
        ends.append((state, estimator.gate_map(0.0)))
    (a, map_a), (b, map_b) = ends
    np.testing.assert_allclose(a.position, b.position, atol=1e-6)
    np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-8)
    np.testing.assert_allclose(map_a.gates[0].position, map_b.gates[0].position, atol=1e-6)
    np.testing.assert_allclose(map_a.gates[0].covariance, map_b.gates[0].covariance, atol=1e-8)


def test_sightings_out_of_order_too_old_or_not_yet_reached_are_not_used():
    world, estimator = Circling(seed=6), FusionEstimator(Config(), a_track())
    flown(world, estimator, 2.0)
    assert not estimator.on_sightings(world.seen(world.stamp + 0.01, (1,)))
    assert not estimator.on_sightings(world.seen(world.stamp - 1.5, (1,)))
    assert estimator.on_sightings(world.seen(world.stamp - 0.02, (1,)))
    assert not estimator.on_sightings(world.seen(world.stamp - 0.05, (1,)))
    assert not estimator.on_sightings(world.seen(world.stamp - 0.02, (1,)))
    strange = world.seen(world.stamp - 0.01, (1,)).gates[0]
    strange.position[1] = np.nan
    assert not estimator.on_sightings(Sightings(world.stamp - 0.01, 0, (), (strange,)))
    assert estimator.gate_map(0.0).gates[0].sightings == 1


def test_a_pose_that_is_not_newer_is_no_news():
    world, estimator = Circling(seed=7), FusionEstimator(Config(), a_track())
    pose, _ = world.advance()
    assert estimator.on_pose(pose) is not None
    assert estimator.on_pose(pose) is None


def test_it_coasts_on_the_inertial_sensors_and_then_falls_silent():
    world, config = Circling(seed=8), Config()
    estimator = FusionEstimator(config, a_track())
    flown(world, estimator, 4.0, gates=(1, 2, 3))
    last, states = world.stamp, []
    for _ in range(200):
        _, felt = world.advance()
        if (state := estimator.on_imu(felt)) is not None:
            states.append(state)
    assert last + 0.015 < states[0].stamp <= last + 0.026
    assert last + config.estimation.coast - 0.011 < states[-1].stamp <= last + config.estimation.coast + 1e-9
    for state in states[:: len(states) // 8]:
        error, sigma = position_error(world, state), np.sqrt(np.diag(state.covariance)[:3])
        assert (abs(error) < 4.0 * sigma + 0.02).all()
    assert np.linalg.norm(position_error(world, states[-1])) < 0.25
    assert states[-1].covariance[0, 0] > states[0].covariance[0, 0]
    # Poses are back: the frame is still the same, and so is the state.
    pose, _ = world.advance()
    back = estimator.on_pose(pose)
    assert back is not None
    assert np.linalg.norm(position_error(world, back)) < 0.3


def test_without_inertial_sensors_nothing_stands_in_for_poses():
    world, estimator = Circling(seed=9), FusionEstimator(Config(), a_track())
    states = flown(world, estimator, 3.0, gates=(1, 2), imu=False)
    assert np.linalg.norm(position_error(world, states[-1])) < 0.2


def test_poses_are_believed_again_after_a_gap_in_which_nothing_was_felt():
    """As after the process was stopped: the vehicle has moved on, and nothing tells how."""
    for gap in (0.3, 0.7, 2.0):
        world, estimator = Circling(seed=17), FusionEstimator(Config(), a_track())
        flown(world, estimator, 4.0)
        for _ in range(int(gap * 200)):
            world.advance()
        state = flown(world, estimator, 0.02, imu=False)[-1]
        assert state.doubt == ""
        sigma = np.sqrt(np.diag(state.covariance))
        assert (abs(position_error(world, state)) < 4.0 * sigma[:3]).all()
        assert (abs(state.velocity - world.motion(state.stamp)[1]) < 4.0 * sigma[3:6]).all()
        assert sigma[3:6].max() < 0.3


def test_a_relocalised_tracker_does_not_move_the_vehicle():
    world, estimator = Circling(seed=10), FusionEstimator(Config(), a_track())
    before = flown(world, estimator, 4.0, gates=(1, 2, 3))[-1]
    turn, shift = quat_from_yaw(1.1), np.array((2.0, -5.0, 0.4))
    for _ in range(100):
        pose, felt = world.advance()
        moved = PoseSample(
            pose.stamp,
            quat_rotate(turn, pose.position) + shift,
            quat_multiply(turn, pose.orientation),
            quat_rotate(turn, pose.velocity),
            pose.angular_velocity,
            3,
            epoch=1,
        )
        estimator.on_imu(felt)
        state = estimator.on_pose(moved)
        assert state is not None
        assert state.doubt == ""
        assert np.linalg.norm(position_error(world, state)) < np.linalg.norm(position_error(world, before)) + 0.05
    assert estimator.on_sightings(Sightings(world.stamp - 0.01, 0, (), (world.sighting(1, world.stamp - 0.01),)))


def test_poses_that_contradict_the_filter_make_it_doubt_itself():
    world, estimator = Circling(seed=11), FusionEstimator(Config(), a_track())
    flown(world, estimator, 3.0, gates=(1, 2, 3))
    doubts = []
    for count in range(40):
        pose, felt = world.advance()
        estimator.on_imu(felt)
        away = PoseSample(
            pose.stamp, pose.position + 3.0 + 0.5 * count, pose.orientation, pose.velocity, pose.angular_velocity, 3
        )
        state = estimator.on_pose(away)
        assert state is not None
        doubts.append(state.doubt)
    assert doubts[0] == ""
    assert "contradict" in doubts[-1]


def test_unplaced_gates_come_into_the_map_when_sightings_agree():
    world, estimator = Circling(seed=12), FusionEstimator(Config(), a_track(known=False))
    flown(world, estimator, 1.5)
    assert estimator.gate_map(0.0).gates == ()
    estimator.on_sightings(world.seen(world.stamp - 0.02, (2,)))
    assert estimator.gate_map(0.0).gates == ()
    flown(world, estimator, 2.0, gates=(2,))
    (gate,) = estimator.gate_map(0.0).gates
    assert gate.gate_id == 2
    assert np.linalg.norm(gate.position - GATES[2][:3]) < 0.15
    assert abs(gate.yaw - GATES[2][3]) < 0.1
    assert any("gate 2 was found" in notice for notice in estimator.take_notices())
    assert estimator.take_notices() == ()


def test_a_gate_that_has_moved_is_learnt_anew_and_told_of():
    world, estimator = Circling(seed=13), FusionEstimator(Config(), a_track())
    flown(world, estimator, 2.0, gates=(1, 2))
    elsewhere = (8.0, 2.0, 1.5, 0.3)
    for _ in range(60):
        flown(world, estimator, 0.03)
        seen = (world.sighting(1, world.stamp - 0.02, gate=elsewhere), world.sighting(2, world.stamp - 0.02))
        estimator.on_sightings(Sightings(world.stamp - 0.02, 0, (), seen))
    gates = {gate.gate_id: gate for gate in estimator.gate_map(0.0).gates}
    assert np.linalg.norm(gates[1].position - elsewhere[:3]) < 0.15
    assert np.linalg.norm(gates[2].position - GATES[2][:3]) < 0.15
    assert any("gate 1 has moved" in notice for notice in estimator.take_notices())


def test_outliers_amid_good_sightings_are_refused_and_told_of():
    world, estimator = Circling(seed=14), FusionEstimator(Config(), a_track())
    flown(world, estimator, 2.0, gates=(1,))
    for count in range(90):
        flown(world, estimator, 0.03)
        gate = (5.0, 4.0, 1.5, 0.3) if count % 3 == 0 else None
        estimator.on_sightings(world.seen(world.stamp - 0.02, (1,), gate=gate))
    (gate, *_) = estimator.gate_map(0.0).gates
    assert np.linalg.norm(gate.position - GATES[1][:3]) < 0.15
    assert any("two places" in notice for notice in estimator.take_notices())


def test_a_gate_is_known_relative_to_the_vehicle_better_than_the_vehicle_to_the_start():
    config = load_config(None, None, ["estimation.start_position=0.5"])
    world, estimator = Circling(config, 15), FusionEstimator(config, a_track())
    state = flown(world, estimator, 3.0, gates=(1,))[-1]
    gate = estimator.gate_map(0.0).gates[0]
    assert np.sqrt(gate.covariance[0, 0]) < 0.1 < np.sqrt(state.covariance[0, 0])


@pytest.mark.parametrize("gates", [0, 1, 20])
def test_any_number_of_gates(gates):
    from flightapp.track import Gate, Start, Track

    course = tuple(
        Gate(id=i, position=(5.0 + i, 0.0, 1.5), yaw_deg=0.0, markers=tuple(range(4 * i, 4 * i + 4)))
        for i in range(gates)
    )
    points = () if gates else ((1.0, 0.0, 1.0),)
    shape = {"dictionary": "4X4_100"}
    track = Track(name="n", start=Start(position=(0.0, 0.0, 0.0)), gate=shape, gates=course, waypoints=points)
    world, estimator = Circling(seed=16), FusionEstimator(Config(), track)
    flown(world, estimator, 1.0)
    assert len(estimator.gate_map(0.0).gates) == gates


def test_a_gate_that_is_no_longer_in_sight_must_be_seen_anew():
    """The vehicle rests before gate 1, which was there and is gone."""
    estimator, rest = FusionEstimator(Config(), a_track()), np.zeros(3)
    heading = quat_from_yaw(GATES[1][3])
    gate = np.array(GATES[1][:3])
    start = gate - 4.0 * np.array((np.cos(GATES[1][3]), np.sin(GATES[1][3]), 0.0))
    way = np.array((4.0, 0.0, 0.0))
    for count in range(400):
        stamp = 0.005 * count
        assert estimator.on_pose(PoseSample(stamp, start, heading, rest, rest, 3)) is not None
        if count % 6 == 1:
            seen = GateSighting(stamp, 1, way, np.array((1.0, 0.0, 0.0, 0.0)), 1e-4 * np.eye(6), None, 4, 0.1)
            estimator.on_sightings(Sightings(stamp - 0.003, count, (), (seen,) if count < 200 else ()))
        known = estimator.gate_map(stamp).gates[0].sightings
        assert (known > 0) == (6 <= count < 320) or count < 6 or 310 < count < 330
    assert estimator.take_notices() == ("gate 1 should be in sight, but is not",)


def test_gates_that_have_changed_places_change_them_in_the_map():
    """One of them is seen first; where the other is follows from that, and its own sightings agree."""
    world, estimator = Circling(seed=18), FusionEstimator(Config(), a_track())
    flown(world, estimator, 2.0, gates=(1, 2, 3))
    changed = []
    while not any(changed):
        flown(world, estimator, 0.03)
        changed.append(estimator.on_sightings(world.seen(world.stamp - 0.02, (1,), gate=GATES[2])))
        assert len(changed) < 30
    assert len(changed) > 10
    gates = {gate.gate_id: gate for gate in estimator.gate_map(0.0).gates}
    for gate_id, elsewhere in ((1, 2), (2, 1)):
        assert np.linalg.norm(gates[gate_id].position - GATES[elsewhere][:3]) < 0.3
    assert (gates[2].sightings, gates[2].surveyed) == (0, False)
    assert np.linalg.norm(gates[3].position - GATES[3][:3]) < 0.15
    for _ in range(10):
        flown(world, estimator, 0.03)
        assert estimator.on_sightings(world.seen(world.stamp - 0.02, (2,), gate=GATES[1]))
    gates = {gate.gate_id: gate for gate in estimator.gate_map(0.0).gates}
    assert gates[2].sightings == 10
    assert np.linalg.norm(gates[2].position - GATES[1][:3]) < 0.15
    assert abs(gates[2].yaw - GATES[1][3]) < 0.1
    notices = estimator.take_notices()
    assert any("gate 1 is where gate 2 was thought to be" in notice for notice in notices)
    assert not any("gate 2 has moved" in notice for notice in notices)
    covariance = estimator._P
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
