"""Distances from what stands in the way."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from flightapp.config import load_config
from flightapp.messages import GateEstimate
from flightapp.planning.obstacles import (
    BALL,
    MARGIN,
    OWNER,
    WIDEST,
    WIDTH,
    Margins,
    beyond,
    distance,
    farther,
    names,
    packed,
)
from flightapp.track import FRAME_THICKNESS, Box, Cylinder, GateShape

MARGINS = Margins(0.2, 0.3, 0.05)
BOX = Box(name="wall", centre=(1.0, -2.0, 1.5), size=(0.4, 3.0, 2.0))
PILLAR = Cylinder(name="pillar", base=(-1.0, 2.0, 0.5), radius=0.4, height=3.0)
SHAPE = GateShape(opening=1.4, border=0.4)
near = st.floats(-4.0, 4.0)
points = st.tuples(near, near, near).map(np.array)


def gate(gate_id=3, position=(0.5, 1.0, 2.0), yaw=0.7):
    return GateEstimate(gate_id, np.array(position), yaw, np.zeros((4, 4)), 9, 0.0)


def to_world(local, position, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(local) @ turn.T + position


def box_surface(half, step=0.05):
    axes = [np.linspace(-h, h, int(2 * h / step) + 2) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[(np.abs(np.abs(grid) - half) < 1e-12).any(axis=1)]


def cylinder_surface(radius, half_height, step=0.05):
    turn = np.linspace(0.0, 2.0 * math.pi, int(2.0 * math.pi * radius / step) + 2)
    ring = np.column_stack((np.cos(turn), np.sin(turn)))
    heights = np.linspace(-half_height, half_height, int(2.0 * half_height / step) + 2)
    radii = np.linspace(0.0, radius, int(radius / step) + 2)
    side = [np.column_stack((radius * ring, np.full(len(ring), h))) for h in heights]
    ends = [np.column_stack((r * ring, np.full(len(ring), h))) for h in (-half_height, half_height) for r in radii]
    return np.concatenate(side + ends)


def frame_surfaces():
    """Each bar of a gate's frame from the measures of the frame, in the gate's own axes."""
    thick = 0.5 * FRAME_THICKNESS
    long, short = box_surface((thick, 1.1, 0.2)), box_surface((thick, 0.2, 0.7))
    up, left = np.array((0.0, 0.0, 0.9)), np.array((0.0, 0.9, 0.0))
    return [long - up, short - left, long + up, short + left]


WORLD = packed((BOX, PILLAR), (gate(),), SHAPE, MARGINS)
SURFACES = [
    box_surface((0.2, 1.5, 1.0)) + BOX.centre,
    cylinder_surface(0.4, 1.5) + np.array((-1.0, 2.0, 2.0)),
    *(to_world(surface, (0.5, 1.0, 2.0), 0.7) for surface in frame_surfaces()),
]


def signed(p, i, rows=WORLD):
    gradient = np.empty(3)
    return distance(np.asarray(p, float), rows, i, gradient), gradient


@given(points, st.integers(0, 5))
def test_distance_is_that_of_the_nearest_point_of_the_surface(p, i):
    d, _ = signed(p, i)
    brute = np.linalg.norm(SURFACES[i] - p, axis=1).min()
    assert abs(d) <= brute + 1e-9
    assert brute - abs(d) < 0.05


@given(points, st.integers(0, 5))
def test_gradient_is_the_derivative_and_points_away_from_the_nearest_point(p, i):
    d, gradient = signed(p, i)
    assume(d > 1e-3)
    assert np.linalg.norm(gradient) == pytest.approx(1.0)
    h = 1e-6
    steps = h * np.eye(3)
    numeric = [(signed(p + step, i)[0] - signed(p - step, i)[0]) / (2.0 * h) for step in steps]
    np.testing.assert_allclose(gradient, numeric, atol=2e-3)
    assert abs(signed(p - d * gradient, i)[0]) < 1e-9


@given(points, points, st.integers(0, 5))
def test_distance_outside_is_convex_with_a_continuous_gradient(p, q, i):
    (a, from_a), (b, from_b) = signed(p, i), signed(q, i)
    middle, _ = signed(0.5 * (p + q), i)
    assert middle <= 0.5 * (max(a, 0.0) + max(b, 0.0)) + 1e-9
    if min(a, b) > 0.0:
        # The nearest points of a convex solid are no farther apart than the points themselves.
        turned = float(np.linalg.norm(from_a - from_b))
        assert turned <= 2.0 * float(np.linalg.norm(p - q)) / min(a, b) + 1e-9


@pytest.mark.parametrize(
    ("p", "i", "depth", "outwards"),
    [
        ((1.15, -2.0, 1.5), 0, -0.05, (1.0, 0.0, 0.0)),
        ((1.0, -2.0, 2.45), 0, -0.05, (0.0, 0.0, 1.0)),
        ((-1.0, 1.65, 2.0), 1, -0.05, (0.0, -1.0, 0.0)),
        ((-1.0, 2.1, 0.6), 1, -0.1, (0.0, 0.0, -1.0)),
        ((-1.0, 2.0, 2.0), 1, -0.4, (1.0, 0.0, 0.0)),
        ((-1.0, 2.0, 4.0), 1, 0.5, (0.0, 0.0, 1.0)),
    ],
)
def test_inside_the_way_out_is_through_the_nearest_face(p, i, depth, outwards):
    d, gradient = signed(p, i)
    assert d == pytest.approx(depth)
    np.testing.assert_allclose(gradient, outwards, atol=1e-12)


@given(points, st.integers(0, 5), st.floats(0.0, 5.0))
def test_what_is_called_beyond_is_so(p, i, reach):
    d, _ = signed(p, i)
    assert not (beyond(p, WORLD, i, reach) and d <= reach)
    if d > reach + 2.0 * WORLD[i, BALL]:
        assert beyond(p, WORLD, i, reach)


@given(points, st.integers(0, 5), st.floats(-1.0, 5.0))
def test_what_is_called_farther_is_so_and_all_of_it(p, i, reach):
    d, _ = signed(p, i)
    if farther(p, WORLD, i, reach):
        assert d > reach >= 0.0
    else:
        assert d <= reach + 1e-9 or reach < 0.0


def test_the_opening_is_free_up_to_the_frame():
    for y, z, free in ((0.0, 0.0, 0.7), (0.5, 0.0, 0.2), (0.0, -0.6, 0.1), (0.5, 0.6, 0.1), (1.2, 0.0, 0.1)):
        p = to_world((0.0, y, z), (0.5, 1.0, 2.0), 0.7)
        assert min(signed(p, i)[0] for i in range(2, 6)) == pytest.approx(free)


def test_rows_know_their_owner_and_margin():
    twice = packed((BOX, PILLAR), (gate(3), gate(4), gate(3)), SHAPE, MARGINS)
    assert twice.shape == (10, WIDTH)
    called = names((BOX, PILLAR), (gate(3), gate(4), gate(3)))
    assert [called[int(owner)] for owner in twice[::2, OWNER]] == [
        "'wall'",
        "the frame of gate 3",
        "the frame of gate 3",
        "the frame of gate 4",
        "the frame of gate 4",
    ]
    assert twice[:, MARGIN].tolist() == [0.5] * 2 + [0.25] * 8
    assert packed((), (gate(),), None, MARGINS).shape == (0, WIDTH)


def test_margins_are_the_vehicle_and_the_clearance():
    config = load_config(None, {"vehicle.radius": 0.25, "planning.clearance": 0.4, "planning.frame_clearance": 0.1})
    assert Margins.of(config) == Margins(0.25, 0.4, 0.1, config.planning.pace_sigmas)


@pytest.mark.parametrize("sigma", [0.1, 5.0])
def test_the_frame_of_a_gate_that_is_not_well_known_is_wider_on_the_outside(sigma):
    wide, known = (
        packed((), (replace(gate(yaw=0.0), covariance=s**2 * np.eye(4)),), SHAPE, replace(MARGINS, sigmas=2.0))
        for s in (sigma, 0.0)
    )
    centre, gradient = gate().position, np.empty(3)
    for bar, outwards in enumerate(((0.0, 0.0, -1.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))):
        outside = centre + 5.0 * np.array(outwards)
        nearer = distance(outside, known, bar, gradient) - distance(outside, wide, bar, gradient)
        assert nearer == pytest.approx(min(2.0 * sigma, WIDEST))
        assert distance(centre, wide, bar, gradient) == pytest.approx(distance(centre, known, bar, gradient))
