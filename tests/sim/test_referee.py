import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flightapp.frames import Vector, quat_from_euler
from flightapp.messages import Collision, GatePassage
from flightapp.track import FRAME_THICKNESS, Box, Cylinder, Gate, GateShape, MarkerLayout, Start, Track
from sim.referee import RELEASE, Referee

RADIUS = 0.25
SHAPE = GateShape(layout=MarkerLayout.TOP)
INNER, OUTER = 0.5 * SHAPE.opening, 0.5 * SHAPE.opening + SHAPE.border


def track(*gates: tuple[float, float, float, float], obstacles: tuple[Box | Cylinder, ...] = ()) -> Track:
    """Gates at (x, y, z, yaw in degrees), with ids from 10."""
    return Track(
        name="test",
        start=Start(position=(0.0, 0.0, 0.0)),
        gate=SHAPE,
        gates=tuple(Gate(id=10 + i, position=g[:3], yaw_deg=g[3], markers=(i,)) for i, g in enumerate(gates)),
        waypoints=() if gates else ((1.0, 0.0, 1.0),),
        obstacles=obstacles,
    )


def fly(*points: tuple[float, float, float], speed: float = 2.0, rate: float = 1000.0, tilt: float = 0.0) -> Vector:
    """Rows (n, 17) of a level flight along straight lines, from stamp 0."""
    corners = np.array(points, float)
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    times = np.concatenate(((0.0,), np.cumsum(lengths / speed)))
    trace = np.zeros((int(times[-1] * rate) + 1, 17))
    trace[:, 0] = np.arange(len(trace)) / rate
    leg = np.clip(np.searchsorted(times, trace[:, 0], side="right") - 1, 0, len(lengths) - 1)
    for axis in range(3):
        trace[:, 1 + axis] = np.interp(trace[:, 0], times, corners[:, axis])
        trace[:, 8 + axis] = (np.diff(corners[:, axis]) / np.diff(times))[leg]
    trace[:, 4:8] = quat_from_euler(tilt, 0.0, 0.0)
    return trace


def through(x: float, y: float, z: float, yaw_deg: float, left: float = 0.0, up: float = 0.0) -> list[tuple]:
    """A straight line of 4 m through a gate, off its centre."""
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return [(x + c * d - s * left, y + s * d + c * left, z + up) for d in (-2.0, 2.0)]


ONE = (3.0, 1.0, 5.0, 0.0)


def test_flight_through_the_centre_passes_cleanly() -> None:
    referee = Referee(track(ONE), RADIUS)
    assert (referee.next_gate, referee.complete) == (10, False)
    (passage,) = referee.observe(fly(*through(*ONE)))
    assert isinstance(passage, GatePassage)
    assert passage.gate_id == 10
    assert passage.stamp == pytest.approx(1.0, abs=1e-9)
    assert passage.offset == pytest.approx(0.0, abs=1e-9)
    assert (referee.passed, referee.next_gate, referee.complete, referee.wrong) == ((10,), None, True, ())


@given(
    st.floats(-180.0, 180.0),
    st.floats(-0.99 * INNER, 0.99 * INNER),
    st.floats(-0.99 * INNER, 0.99 * INNER),
    st.floats(0.5, 25.0),
)
def test_offset_and_stamp_are_those_at_the_plane(yaw_deg: float, left: float, up: float, speed: float) -> None:
    gate = (-2.0, 4.0, 6.0, yaw_deg)
    verdicts = Referee(track(gate), RADIUS).observe(fly(*through(*gate, left, up), speed=speed))
    (passage,) = [v for v in verdicts if isinstance(v, GatePassage)]
    assert passage.offset == pytest.approx(math.hypot(left, up), abs=1e-9)
    assert passage.stamp == pytest.approx(2.0 / speed, abs=1e-9)


@pytest.mark.parametrize(("left", "up"), [(INNER + 0.01, 0.0), (0.0, -INNER - 0.01), (2.0, 0.0), (0.0, 3.0)])
def test_beside_the_opening_is_no_passage(left: float, up: float) -> None:
    referee = Referee(track(ONE), RADIUS)
    verdicts = referee.observe(fly(*through(*ONE, left, up)))
    assert not [v for v in verdicts if isinstance(v, GatePassage)]
    assert (referee.passed, referee.wrong) == ((), ())


def test_flight_that_turns_back_before_the_plane_is_no_passage() -> None:
    referee = Referee(track(ONE), RADIUS)
    assert referee.observe(fly((1.0, 1.0, 5.0), (2.999, 1.0, 5.0), (1.0, 1.0, 5.0))) == []
    assert (referee.passed, referee.wrong) == ((), ())


def test_passage_from_behind_does_not_count() -> None:
    referee = Referee(track(ONE), RADIUS)
    assert referee.observe(fly(*reversed(through(*ONE, left=0.3)))) == []
    (wrong,) = referee.wrong
    assert wrong.backwards
    assert wrong.gate_id == 10
    assert wrong.offset == pytest.approx(0.3)
    assert referee.next_gate == 10


TWO = ((2.0, 0.0, 5.0, 0.0), (6.0, 0.0, 5.0, 0.0))


def test_gate_out_of_order_does_not_count() -> None:
    referee = Referee(track(*TWO[::-1]), RADIUS)  # the nearer one is second
    (passage,) = referee.observe(fly((0.0, 0.0, 5.0), (8.0, 0.0, 5.0)))
    assert passage.gate_id == 10
    assert [(w.gate_id, w.backwards) for w in referee.wrong] == [(11, False)]
    assert (referee.passed, referee.next_gate) == ((10,), 11)


def test_gate_passed_twice_counts_once() -> None:
    referee = Referee(track(*TWO), RADIUS)
    referee.observe(fly((0.0, 0.0, 5.0), (4.0, 0.0, 5.0), (0.0, 0.0, 5.0), (8.0, 0.0, 5.0)))
    assert referee.passed == (10, 11)
    assert [(w.gate_id, w.backwards) for w in referee.wrong] == [(10, True), (10, False)]


def test_laps_pass_every_gate_again() -> None:
    lap = [(0.0, 0.0, 5.0), (8.0, 0.0, 5.0), (8.0, 0.0, 9.0), (0.0, 0.0, 9.0)]
    referee = Referee(track(*TWO), RADIUS, laps=2)
    verdicts = referee.observe(fly(*lap, *lap))
    assert [v.gate_id for v in verdicts if isinstance(v, GatePassage)] == [10, 11, 10, 11]
    assert (referee.lap, referee.complete) == (2, True)
    half = Referee(track(*TWO), RADIUS, laps=2)
    half.observe(fly(*lap))
    assert (half.lap, half.complete, half.next_gate) == (1, False, 10)


@settings(max_examples=25)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=8), st.floats(-1.6, 1.6))
def test_verdicts_do_not_depend_on_how_the_trace_is_cut(cuts: list[int], left: float) -> None:
    trace = fly(*through(*ONE, left), (5.0, 1.0, 0.0), speed=5.0)
    pieces, begin, i = [], 0, 0
    while begin < len(trace):
        pieces.append(trace[begin : begin + cuts[i % len(cuts)]])
        begin += len(pieces[-1])
        i += 1
    referee = Referee(track(ONE), RADIUS)
    assert [v for piece in pieces for v in referee.observe(piece)] == Referee(track(ONE), RADIUS).observe(trace)


def test_long_trace_with_many_verdicts_loses_none() -> None:
    there_and_back = [(2.0, 1.0, 5.0), (4.0, 1.0, 5.0)] * 100
    referee = Referee(track(ONE), RADIUS, laps=100)
    assert len(referee.observe(fly(*there_and_back, speed=20.0))) == 100
    assert len(referee.wrong) == 99


def frame_gap(left: float, up: float) -> float:
    """Distance in the gate's plane from its frame, by the two squares that bound it."""
    a, b = abs(left), abs(up)
    outside = math.hypot(max(a - OUTER, 0.0), max(b - OUTER, 0.0))
    return outside if outside > 0.0 else max(INNER - max(a, b), 0.0)


@given(st.floats(-180.0, 180.0), st.floats(-1.8, 1.8), st.floats(-1.8, 1.8))
def test_ball_hits_the_frame_where_it_is_nearer_than_its_radius(yaw_deg: float, left: float, up: float) -> None:
    gap = frame_gap(left, up)
    if abs(gap - RADIUS) < 1e-6:
        return
    gate = (3.0, 1.0, 5.0, yaw_deg)
    verdicts = Referee(track(gate), RADIUS).observe(fly(*through(*gate, left, up)))
    hits = [v.obstacle for v in verdicts if isinstance(v, Collision)]
    assert hits == (["gate 10"] if gap < RADIUS else [])


DIAGONAL = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("edge", "away"),
    [
        ((INNER, 0.2), (-1.0, 0.0)),
        ((-INNER, 0.2), (1.0, 0.0)),
        ((0.2, INNER), (0.0, -1.0)),
        ((0.2, -INNER), (0.0, 1.0)),
        ((OUTER, 0.9), (1.0, 0.0)),
        ((-OUTER, 0.3), (-1.0, 0.0)),
        ((0.9, OUTER), (0.0, 1.0)),
        ((0.3, -OUTER), (0.0, -1.0)),
        ((OUTER, OUTER), (DIAGONAL, DIAGONAL)),
        ((-OUTER, OUTER), (-DIAGONAL, DIAGONAL)),
        ((OUTER, -OUTER), (DIAGONAL, -DIAGONAL)),
    ],
)
def test_frame_ends_where_it_should(edge: tuple[float, float], away: tuple[float, float]) -> None:
    gate = (3.0, 1.0, 5.0, 40.0)
    for gap, hits in ((RADIUS - 1e-3, 1), (RADIUS + 1e-3, 0)):
        left, up = edge[0] + gap * away[0], edge[1] + gap * away[1]
        verdicts = Referee(track(gate), RADIUS).observe(fly(*through(*gate, left, up)))
        assert len([v for v in verdicts if isinstance(v, Collision)]) == hits


def test_head_on_collision_is_told_at_the_touch() -> None:
    border = 0.5 * (INNER + OUTER)
    (hit,) = Referee(track(ONE), RADIUS).observe(fly(*through(*ONE, up=border), speed=4.0))
    assert isinstance(hit, Collision)
    assert hit.stamp == pytest.approx((2.0 - 0.5 * FRAME_THICKNESS - RADIUS) / 4.0, abs=1.1e-3)
    assert hit.speed == pytest.approx(4.0)


def test_a_contact_is_told_once_and_the_next_one_again() -> None:
    touching = 3.0 - 0.5 * FRAME_THICKNESS - RADIUS + 0.01
    scrape = [(1.0, 1.9, 5.0), (touching, 1.9, 5.0), (touching - 0.02, 1.9, 5.0), (touching, 1.9, 5.0)]
    assert len(Referee(track(ONE), RADIUS).observe(fly(*scrape))) == 1
    again = [*scrape, (touching - 0.02 - RELEASE, 1.9, 5.0), (touching, 1.9, 5.0)]
    assert len(Referee(track(ONE), RADIUS).observe(fly(*again))) == 2


def test_obstacles_are_hit_by_name() -> None:
    wall = Box(name="wall", centre=(3.0, 0.0, 5.0), size=(0.02, 4.0, 4.0))
    elsewhere = track((-9.0, 0.0, 5.0, 0.0), obstacles=(wall,))
    referee = Referee(elsewhere, RADIUS)
    (hit,) = referee.observe(fly((0.0, 0.0, 5.0), (6.0, 0.0, 5.0)))
    assert isinstance(hit, Collision)
    assert hit.obstacle == "wall"
    assert hit.stamp == pytest.approx((3.0 - 0.01 - RADIUS) / 2.0, abs=1.1e-3)
    beside = 2.0 + RADIUS + 0.001
    assert Referee(elsewhere, RADIUS).observe(fly((0.0, beside, 5.0), (6.0, beside, 5.0))) == []


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 1.2), st.floats(0.5, 4.0))
def test_a_pillar_is_hit_where_the_ball_meets_its_round_side_or_its_rim(
    way: float, aside: float, height: float
) -> None:
    pillar = Cylinder(name="pillar", base=(30.0, -4.0, 0.5), radius=0.5, height=2.0)
    c, s = math.cos(way), math.sin(way)
    from_to = [(30.0 + d * c - aside * s, -4.0 + d * s + aside * c, height) for d in (-3.0, 3.0)]
    over = max(height - 2.5, 0.0)
    reach = 0.5 + math.sqrt(max(RADIUS**2 - over**2, 0.0)) if over < RADIUS else 0.0
    assume(abs(aside - reach) > 2e-3 and abs(over - RADIUS) > 2e-3)
    hits = [
        hit for hit in Referee(track(obstacles=(pillar,)), RADIUS).observe(fly(*from_to)) if isinstance(hit, Collision)
    ]
    assert [hit.obstacle for hit in hits] == (["pillar"] if aside < reach else [])
    if hits:
        assert hits[0].stamp == pytest.approx(
            (3.0 - math.sqrt(reach**2 - aside**2)) / 2.0, abs=3e-3 + 0.02 * (aside > 0.6)
        )


@given(st.floats(0.0, 1.0))
def test_coarse_trace_jumps_over_nothing(phase: float) -> None:
    wall = Box(name="wall", centre=(30.0, 0.0, 5.0), size=(0.02, 4.0, 4.0))
    referee = Referee(track(obstacles=(wall,)), RADIUS)
    hits = referee.observe(fly((phase, 0.0, 5.0), (60.0, 0.0, 5.0), speed=40.0, rate=40.0))
    assert [hit.obstacle for hit in hits if isinstance(hit, Collision)] == ["wall"]


def test_soft_landing_and_standing_are_no_collisions() -> None:
    up_and_down = [(0.0, 0.0, -0.002), (0.0, 0.0, 1.0), (0.0, 0.0, -0.002), (0.01, 0.0, -0.002)]
    assert Referee(track(), RADIUS).observe(fly(*up_and_down, speed=0.7)) == []


def test_hard_landing_is_a_collision_with_the_ground() -> None:
    (hit,) = Referee(track(), RADIUS).observe(fly((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), speed=1.5))
    assert isinstance(hit, Collision)
    assert hit.obstacle == "ground"
    assert hit.speed == pytest.approx(1.5)


@pytest.mark.parametrize(("tilt_deg", "hits"), [(55.0, 0), (65.0, 1), (180.0, 1)])
def test_landing_on_its_side_is_a_collision(tilt_deg: float, hits: int) -> None:
    down = fly((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), speed=0.5, tilt=math.radians(tilt_deg))
    assert len(Referee(track(), RADIUS).observe(down)) == hits


def test_tilted_body_meets_the_ground_with_its_rim() -> None:
    down = fly((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), speed=0.5, tilt=math.radians(70.0))
    (hit,) = Referee(track(), RADIUS).observe(down)
    height = 2.0 - 0.5 * hit.stamp
    assert height == pytest.approx(RADIUS * math.sin(math.radians(70.0)), abs=0.011)


def test_falling_over_after_a_landing_is_a_collision() -> None:
    referee = Referee(track(), RADIUS)
    assert referee.observe(fly((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), speed=0.5)) == []
    fallen = fly((0.0, 0.0, 0.1), (0.0, 0.1, 0.1), speed=0.5, tilt=1.3)
    assert len(referee.observe(fallen)) == 1


def test_gate_that_reaches_underground_is_passed_all_the_same() -> None:
    low = (2.0, 0.0, 0.75, 0.0)
    (passage,) = Referee(track(low), RADIUS).observe(fly(*through(*low)))
    assert isinstance(passage, GatePassage)


def test_track_without_gates_is_complete() -> None:
    referee = Referee(track(), RADIUS)
    assert (referee.complete, referee.next_gate, referee.lap, referee.passed) == (True, None, 0, ())


def test_nothing_happens_in_an_empty_piece() -> None:
    assert Referee(track(ONE), RADIUS).observe(np.empty((0, 17))) == []


def test_bench_referee(benchmark: object) -> None:
    gates = [(4.0 * i, 0.0, 5.0, 0.0) for i in range(1, 6)]
    referee = Referee(track(*gates), RADIUS)
    piece = fly((3.0, 0.0, 5.0), (3.008, 0.0, 5.0))[:4]
    benchmark(referee.observe, piece)
