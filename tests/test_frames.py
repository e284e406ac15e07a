import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.frames import (
    R_BODY_OPTICAL,
    Vector,
    camera_mount,
    flip_yz,
    quat_conjugate,
    quat_from_euler,
    quat_from_matrix,
    quat_from_rotvec,
    quat_from_yaw,
    quat_multiply,
    quat_normalize,
    quat_rotate,
    quat_rotate_inverse,
    quat_to_euler,
    quat_to_matrix,
    quat_to_rotvec,
    quat_yaw,
    slerp,
    wrap_angle,
)

numbers = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi, math.pi)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
fractions = st.floats(0.0, 1.0)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-3).map(quat_normalize)
)


def same_rotation(a: Vector, b: Vector, tolerance: float = 1e-7) -> bool:
    """Whether two quaternions turn alike: q and −q do; 1 − |a·b| grows with the square of the angle."""
    return abs(abs(float(a @ b)) - 1.0) < tolerance**2 + 4e-15


@given(quaternions)
def test_matrix_of_a_quaternion_is_a_rotation_and_leads_back(q: Vector) -> None:
    R = quat_to_matrix(q)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    back = quat_from_matrix(R)
    assert back[0] >= 0.0
    assert same_rotation(back, q)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_survive_the_matrix(axis: int) -> None:
    q = np.zeros(4)
    q[1 + axis] = 1.0
    assert same_rotation(quat_from_matrix(quat_to_matrix(q)), q)


@given(quaternions, vectors)
def test_rotating_is_multiplying_with_the_matrix(q: Vector, v: Vector) -> None:
    np.testing.assert_allclose(quat_rotate(q, v), quat_to_matrix(q) @ v, atol=1e-12)
    np.testing.assert_allclose(quat_rotate_inverse(q, v), quat_to_matrix(q).T @ v, atol=1e-12)


@given(quaternions, quaternions)
def test_product_is_the_product_of_matrices(a: Vector, b: Vector) -> None:
    np.testing.assert_allclose(quat_to_matrix(quat_multiply(a, b)), quat_to_matrix(a) @ quat_to_matrix(b), atol=1e-12)


@given(quaternions)
def test_conjugate_is_the_inverse(q: Vector) -> None:
    np.testing.assert_allclose(quat_multiply(q, quat_conjugate(q)), (1.0, 0.0, 0.0, 0.0), atol=1e-12)


@given(quaternions)
def test_rotation_vector_leads_back_and_is_the_short_way(q: Vector) -> None:
    r = quat_to_rotvec(q)
    assert np.linalg.norm(r) <= math.pi + 1e-12
    assert same_rotation(quat_from_rotvec(r), q)


@given(st.floats(-12.0, 0.0), st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array))
def test_small_rotation_vectors_keep_their_relative_accuracy(exponent: float, direction: Vector) -> None:
    r = 10.0**exponent * direction
    np.testing.assert_allclose(quat_to_rotvec(quat_from_rotvec(r)), r, rtol=1e-6, atol=1e-300)


def test_rotation_vector_turns_by_the_right_hand() -> None:
    quarter = quat_from_rotvec(np.array((0.0, 0.0, 0.5 * math.pi)))
    np.testing.assert_allclose(quat_rotate(quarter, np.array((1.0, 0.0, 0.0))), (0.0, 1.0, 0.0), atol=1e-15)


def test_normalising_zero_gives_the_identity() -> None:
    np.testing.assert_array_equal(quat_normalize(np.zeros(4)), (1.0, 0.0, 0.0, 0.0))


@given(angles, st.floats(-1.5, 1.5), angles)
def test_yaw_of_euler_angles_is_their_yaw(roll: float, pitch: float, yaw: float) -> None:
    q = quat_from_euler(roll, pitch, yaw)
    assert abs(wrap_angle(quat_yaw(q) - yaw)) < 1e-9


@given(angles, angles, angles)
def test_euler_angles_are_turns_about_z_then_y_then_x(roll: float, pitch: float, yaw: float) -> None:
    turns = [quat_from_rotvec(np.array(r)) for r in ((0.0, 0.0, yaw), (0.0, pitch, 0.0), (roll, 0.0, 0.0))]
    assert same_rotation(quat_multiply(quat_multiply(turns[0], turns[1]), turns[2]), quat_from_euler(roll, pitch, yaw))


@given(angles)
def test_yaw_alone(yaw: float) -> None:
    assert same_rotation(quat_from_yaw(yaw), quat_from_euler(0.0, 0.0, yaw))


@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_point_the_same_way(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)


def test_wrapping_sends_the_upper_end_to_the_lower() -> None:
    assert wrap_angle(math.pi) == -math.pi


@given(quaternions, quaternions)
def test_slerp_begins_and_ends_where_it_should(a: Vector, b: Vector) -> None:
    assert same_rotation(slerp(a, b, 0.0), a)
    assert same_rotation(slerp(a, b, 1.0), b)


@given(quaternions, quaternions, fractions)
def test_slerp_turns_steadily_the_short_way(a: Vector, b: Vector, fraction: float) -> None:
    def angle(p: Vector, q: Vector) -> float:
        return float(np.linalg.norm(quat_to_rotvec(quat_multiply(quat_conjugate(p), q))))

    assert angle(a, slerp(a, b, fraction)) == pytest.approx(fraction * angle(a, b), abs=1e-7)


@given(vectors)
def test_flip_undoes_itself(v: Vector) -> None:
    np.testing.assert_array_equal(flip_yz(flip_yz(v)), v)
    np.testing.assert_array_equal(flip_yz(v), v * (1.0, -1.0, -1.0))


@given(quaternions, vectors)
def test_flipped_rotation_turns_flipped_vectors(q: Vector, v: Vector) -> None:
    flipped = np.concatenate((q[:1], flip_yz(q[1:])))
    np.testing.assert_allclose(quat_rotate(flipped, flip_yz(v)), flip_yz(quat_rotate(q, v)), atol=1e-12)


def test_level_camera_looks_ahead_with_its_x_to_the_right() -> None:
    R = camera_mount(0.0)
    np.testing.assert_allclose(R, R_BODY_OPTICAL, atol=1e-15)
    np.testing.assert_allclose(R @ (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(R @ (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(R @ (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), atol=1e-15)


@given(st.floats(0.01, 1.5))
def test_camera_tilted_up_looks_up(pitch_up: float) -> None:
    axis = camera_mount(pitch_up) @ (0.0, 0.0, 1.0)
    np.testing.assert_allclose(axis, (math.cos(pitch_up), 0.0, math.sin(pitch_up)), atol=1e-12)


def test_camera_turned_left_looks_left() -> None:
    np.testing.assert_allclose(camera_mount(0.0, yaw=0.5 * math.pi) @ (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.55, 1.55), st.floats(-3.1, 3.1))
def test_euler_angles_come_back(roll, pitch, yaw):
    assert quat_to_euler(quat_from_euler(roll, pitch, yaw)) == pytest.approx((roll, pitch, yaw), abs=1e-6)


def test_euler_angles_at_the_pole_are_finite():
    assert quat_to_euler(quat_from_euler(0.0, 0.5 * math.pi, 0.0))[1] == pytest.approx(0.5 * math.pi, abs=1e-6)
