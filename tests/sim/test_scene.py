import cv2
import numpy as np
import pytest
from camera_cases import make_track, one_gate
from hypothesis import assume, given
from hypothesis import strategies as st

from flightapp.frames import Vector
from flightapp.track import Box, Cylinder, Gate, GateShape
from sim.order import far_to_near, quad_normals, quad_vertices
from sim.scene import Quads, Scene, board_side


def test_markers_are_those_of_the_dictionary() -> None:
    black = Scene.from_track(one_gate()).boards.black[2]
    cells = (black[1:, 1:] - black[:-1, 1:] - black[1:, :-1] + black[:-1, :-1])[::-1, ::-1]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    np.testing.assert_array_equal(cells, cv2.aruco.generateImageMarker(dictionary, 2, 6) == 0)


def test_corners_turn_with_the_gate() -> None:
    corners = Scene.from_track(one_gate((4.0, 0.0, 1.5), 90.0)).boards.corners
    # Flying towards +y, left is -x: the first marker's top left corner is at y = 0.9 + 0.15 in the gate's frame.
    np.testing.assert_allclose(corners[0, 0], (4.0 - 1.05, 0.0, 1.5 + 1.05), atol=1e-12)
    np.testing.assert_allclose(corners[2, 2], (4.0 + 1.05, 0.0, 1.5 - 1.05), atol=1e-12)


def test_nothing_reaches_underground() -> None:
    box = Box(name="pole", centre=(2.0, 0.0, 0.5), size=(0.2, 0.2, 3.0))
    gate = Gate(id=0, position=(4.0, 0.0, 0.8), yaw_deg=20.0, markers=(0, 1, 2, 3))
    vertices = quad_vertices(Scene.from_track(make_track(gate, obstacles=(box,))).quads)
    assert len(vertices) == 6
    assert vertices[:, :, 2].min() == pytest.approx(0.0, abs=1e-12)
    assert vertices[0, :, 2].max() == pytest.approx(0.8 + 1.1)


def test_what_is_wholly_underground_is_not_drawn() -> None:
    buried = Cylinder(name="root", base=(2.0, 0.0, -3.0), radius=0.2, height=2.0)
    half = Cylinder(name="stump", base=(3.0, 1.0, -1.0), radius=0.3, height=1.5)
    gate = Gate(id=0, position=(4.0, 0.0, 1.8), yaw_deg=20.0, markers=(0, 1, 2, 3))
    scene = Scene.from_track(make_track(gate, obstacles=(buried, half)))
    vertices = quad_vertices(scene.seen_from(np.array([0.0, 1.0, 1.0])))
    assert vertices[1:, :, 0].min() > 2.6
    assert (vertices[1:, :, 2].min(), vertices[1:, :, 2].max()) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.5))


@pytest.mark.parametrize(("border", "side"), [(0.4, 0.4), (1.0, 0.4), (0.32, 0.32)])
def test_quiet_zone_is_one_cell_where_it_fits(border: float, side: float) -> None:
    assert board_side(GateShape(border=border), 6) == pytest.approx(side)


def test_far_quads_come_before_near_ones_even_if_their_middles_are_nearer() -> None:
    wide = Box(name="wall", centre=(6.0, 9.0, 1.0), size=(0.2, 22.0, 2.0))
    gate = Gate(id=0, position=(7.0, 0.0, 1.0), yaw_deg=0.0, markers=(0, 1, 2, 3))
    quads = Scene.from_track(make_track(gate, obstacles=(wide,))).quads
    order = list(far_to_near(quad_vertices(quads), quad_normals(quads), np.array([0.0, 0.0, 1.0])))
    wall_front = int(np.argmax(quad_normals(quads)[1:, 0] > 0.5)) + 1
    assert sorted(order) == list(range(len(order)))
    assert order.index(0) < order.index(wall_front)


def quad_shadow(quads: Quads, eye: Vector, p: Vector) -> bool:
    """Whether any quad that is drawn on the side of ``eye`` stands between it and ``p``."""
    normal = np.cross(quads.along, quads.up)
    here, there = ((quads.origin - end) * normal for end in (eye, p))
    here, there = here.sum(axis=1), there.sum(axis=1)
    crossed = (here > 0.0) & (there < 0.0)
    share = here / np.where(crossed, here - there, np.inf)
    hit = eye + share[:, None] * (p - eye) - quads.origin
    s, t = (hit * quads.along).sum(axis=1), (hit * quads.up).sum(axis=1)
    low_s, high_s, low_t, high_t = quads.bounds.T
    inside = (low_s < s) & (s < high_s) & (low_t < t) & (t < high_t)
    return bool((inside & crossed).any())


@pytest.mark.parametrize("distance", [0.6, 3.0, 20.0])
@given(around=st.floats(-3.1, 3.1), height=st.floats(0.2, 2.8), aside=st.floats(-1.5, 1.5))
def test_a_pillar_hides_what_its_round_outline_hides(
    distance: float, around: float, height: float, aside: float
) -> None:
    pillar = Cylinder(name="pillar", base=(1.0, 2.0, 0.0), radius=0.4, height=3.0)
    scene = Scene.from_track(
        make_track(Gate(id=0, position=(50, 0, 2), yaw_deg=0, markers=(0, 1, 2, 3)), obstacles=(pillar,))
    )
    away = np.array([np.cos(around), np.sin(around), 0.0])
    left = np.array([-away[1], away[0], 0.0])
    middle = np.array([1.0, 2.0, height])
    eye, p = middle + distance * away, middle - 4.0 * away + aside * left
    ray = (p - eye) / np.linalg.norm(p - eye)
    miss = abs(float(np.cross(ray, middle - eye)[2]))
    assume(abs(miss - 0.4) > 1e-6)
    assert quad_shadow(scene.seen_from(eye), eye, p) == (miss < 0.4)


def test_a_low_pillar_shows_its_top_to_who_looks_down_on_it() -> None:
    low = Cylinder(name="low", base=(0.0, 0.0, 0.0), radius=0.5, height=1.0)
    scene = Scene.from_track(
        make_track(Gate(id=0, position=(50, 0, 2), yaw_deg=0, markers=(0, 1, 2, 3)), obstacles=(low,))
    )
    eye = np.array([0.1, 0.0, 4.0])
    grid = np.linspace(-0.6, 0.6, 61)
    ground = [np.array([x, y, 0.9]) for x in grid for y in grid]
    hidden = np.array([quad_shadow(scene.seen_from(eye), eye, p) for p in ground])
    at_top = np.array([eye + (p - eye) * 3.0 / 3.1 for p in ground])
    radius = np.hypot(at_top[:, 0], at_top[:, 1])
    assert not hidden[radius > 0.51].any()
    assert hidden[radius < 0.42].all()
    assert hidden.sum() * (1.2 / 60) ** 2 * (3.0 / 3.1) ** 2 == pytest.approx(0.908 * np.pi * 0.25, rel=0.03)
