"""Where gates are expected in the image."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from perception_cases import LENSES, PINHOLE, gate_pixels

from flightapp.config import Detection
from flightapp.frames import Vector, quat_from_euler, quat_from_yaw, quat_rotate, quat_to_matrix
from flightapp.messages import GateEstimate
from flightapp.perception.boxes import merge_regions
from flightapp.perception.camera import CameraModel
from flightapp.perception.regions import expected_regions
from flightapp.track import GateShape

SHAPE = GateShape()
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
UNIT = st.floats(-1.0, 1.0)


def gate(
    position: tuple[float, float, float], yaw: float = 0.0, sigma: float = 0.05, sigma_yaw: float = 0.02
) -> GateEstimate:
    return GateEstimate(0, np.array(position), yaw, np.diag([sigma**2] * 3 + [sigma_yaw**2]), 1, 0.0)


def regions(
    gates: list[GateEstimate], camera: CameraModel = PINHOLE, orientation: Vector = LEVEL
) -> list[Vector] | None:
    return expected_regions(gates, np.zeros(3), orientation, camera, SHAPE, Detection())


@pytest.mark.parametrize("lens", LENSES)
@settings(deadline=None, max_examples=150)
@given(
    distance=st.floats(1.0, 12.0),
    bearing=st.tuples(UNIT, UNIT),
    attitude=st.tuples(UNIT, UNIT, UNIT),
    yaw=UNIT,
    sigma=st.floats(0.0, 0.4),
    sigma_yaw=st.floats(0.0, 0.2),
    off=st.tuples(UNIT, UNIT, UNIT),
    turned=UNIT,
)
def test_markers_are_seen_where_they_are_expected(
    lens, distance, bearing, attitude, yaw, sigma, sigma_yaw, off, turned
):
    """Whatever the true gate is, within three sigma, each marker that is wholly in the image is in a box."""
    camera = LENSES[lens]
    orientation = quat_from_euler(*(0.5 * np.array(attitude)))
    direction = quat_rotate(orientation, np.array([1.0, bearing[0], 0.7 * bearing[1]]))
    estimate = gate(tuple(distance * direction / np.linalg.norm(direction)), yaw, sigma, sigma_yaw)
    shift = 3.0 * sigma * np.array(off) / max(1.0, float(np.linalg.norm(off)))
    q_wg = quat_from_yaw(yaw + 3.0 * sigma_yaw * turned)
    true_position = estimate.position + shift
    facing = quat_rotate(q_wg, np.array([1.0, 0.0, 0.0])) @ (true_position - quat_to_matrix(orientation) @ camera.p_bc)
    assume(facing > 0.0)
    R_bg = quat_to_matrix(orientation).T @ quat_to_matrix(q_wg)
    relative = quat_to_matrix(orientation).T @ true_position
    points = SHAPE.marker_corners() @ R_bg.T + relative
    rays = (points - camera.p_bc) @ camera.R_bc
    ahead = rays[:, :, 2] > math.cos(math.radians(81.0)) * np.linalg.norm(rays, axis=2)
    boxes = regions([estimate], camera, orientation)
    if boxes is None:
        return
    for corners, visible in zip(rays, ahead, strict=True):
        pixels = camera.project(corners)
        if visible.all() and camera.contains(pixels).all():
            inside = [(pixels >= box[:2]).all() and (pixels <= box[2:]).all() for box in boxes]
            assert any(inside)


def test_boxes_are_no_larger_than_they_need_be() -> None:
    """At 6 m, known to 1 cm: each box is its marker, 20 px and what 3 cm look like there."""
    boxes = regions([gate((6.0, 0.0, 1.0), sigma=0.01, sigma_yaw=0.0)])
    pixels = gate_pixels(PINHOLE, SHAPE, np.array([6.0, 0.0, 1.0]), LEVEL)
    assert boxes is not None
    seen = merge_regions([np.r_[p.min(0) - 24.0, p.max(0) + 24.0] for p in pixels], PINHOLE.width, PINHOLE.height)
    assert sum(np.prod(box[2:] - box[:2]) for box in boxes) <= sum((c - a) * (d - b) for a, b, c, d in seen)


@pytest.mark.parametrize(
    "unseen",
    [
        gate((-4.0, 0.0, 0.0)),
        gate((4.0, 0.0, 0.0), yaw=math.pi),
        gate((0.3, 6.0, 0.0), yaw=math.pi / 2),
        gate((16.0, 0.0, 2.0)),
    ],
    ids=["behind", "from behind", "outside", "too far"],
)
def test_gates_that_cannot_be_seen_are_left_out(unseen: GateEstimate) -> None:
    assert regions([unseen]) == []
    seen = regions([gate((6.0, 0.0, 1.0))])
    both = regions([gate((6.0, 0.0, 1.0)), unseen])
    assert seen
    assert np.array_equal(both, seen)


def test_the_whole_image_is_searched_for_a_gate_that_may_be_anywhere() -> None:
    assert regions([gate((5.0, 0.0, 1.0), sigma=1.5)]) is None
    assert regions([gate((1.0, 0.0, 0.5), sigma=0.3)]) is None


@settings(max_examples=200)
@given(
    boxes=st.lists(
        st.tuples(st.floats(-900, 900), st.floats(-900, 900), st.floats(-50, 400), st.floats(-50, 400)), max_size=8
    )
)
def test_merged_boxes_cover_the_same_pixels_once(boxes: list[tuple[float, float, float, float]]) -> None:
    given_boxes = [np.array([x, y, x + w, y + h]) for x, y, w, h in boxes]
    count = np.zeros((480, 640), int)
    wanted = np.zeros((480, 640), bool)
    for x0, y0, x1, y1 in merge_regions(given_boxes, 640, 480):
        assert 0 <= x0 < x1 <= 640
        assert 0 <= y0 < y1 <= 480
        count[y0:y1, x0:x1] += 1
    for x0, y0, x1, y1 in given_boxes:
        wanted[max(math.ceil(y0), 0) : max(math.ceil(y1), 0), max(math.ceil(x0), 0) : max(math.ceil(x1), 0)] = True
    assert count.max() <= 1
    assert (count[wanted] == 1).all()


def test_boxes_without_sense_are_left_out() -> None:
    nonsense = [np.array([np.nan, 0.0, 10.0, 10.0]), np.array([0.0, 0.0, np.inf, 10.0]), np.array([9.0, 9.0, 3.0, 3.0])]
    assert merge_regions(nonsense, 640, 480) == []


def test_near_boxes_are_merged_and_distant_ones_are_not() -> None:
    near = merge_regions([np.array([0.0, 0.0, 50.0, 50.0]), np.array([60.0, 0.0, 110.0, 50.0])], 640, 480)
    assert near == [(0, 0, 110, 50)]
    far = merge_regions([np.array([0.0, 0.0, 50.0, 50.0]), np.array([560.0, 400.0, 610.0, 450.0])], 640, 480)
    assert len(far) == 2
