import cv2
import numpy as np
import pytest
from camera_cases import make_track, one_gate

from flightapp.track import Box, Gate, GateShape
from sim.order import far_to_near, quad_normals, quad_vertices
from sim.scene import Scene, board_side


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
