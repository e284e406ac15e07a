"""Gates as squares in space."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.evaluation.gates import crossings, gate_outline

ANGLE, METRE = st.floats(-math.pi, math.pi), st.floats(-20.0, 20.0)


def straight(position, yaw, left, up, backwards=False):
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    across = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    through = position + left * across + np.array([0.0, 0.0, up])
    stamps = np.linspace(0.0, 4.0, 5)
    way = (stamps - 1.75) * (-1.0 if backwards else 1.0)
    return stamps, through + way[:, None] * ahead


@given(METRE, METRE, METRE, ANGLE, st.floats(-0.69, 0.69), st.floats(-0.69, 0.69))
def test_path_through_the_opening_is_found_where_and_when_it_is(x, y, z, yaw, left, up):
    position = np.array([x, y, z])
    (crossing,) = crossings(*straight(position, yaw, left, up), position, yaw, 1.4)
    assert crossing.stamp == pytest.approx(1.75, abs=1e-6)
    assert crossing.offset == pytest.approx(math.hypot(left, up), abs=1e-6)


@pytest.mark.parametrize(("left", "up", "backwards"), [(0.71, 0.0, False), (0.0, -0.71, False), (0.0, 0.0, True)])
def test_path_beside_or_against_the_gate_is_no_passage(left, up, backwards):
    position = np.array([1.0, 2.0, 3.0])
    assert crossings(*straight(position, 0.7, left, up, backwards), position, 0.7, 1.4) == ()


def test_path_of_one_point_crosses_nothing():
    assert crossings(np.zeros(1), np.zeros((1, 3)), np.zeros(3), 0.0, 1.4) == ()


@given(METRE, METRE, METRE, ANGLE)
def test_outline_is_a_square_across_the_direction_of_passage(x, y, z, yaw):
    position = np.array([x, y, z])
    outline = gate_outline(position, yaw, 1.4)
    assert np.array_equal(outline[0], outline[4])
    assert np.allclose(np.linalg.norm(np.diff(outline, axis=0), axis=1), 1.4)
    assert np.allclose((outline - position) @ [math.cos(yaw), math.sin(yaw), 0.0], 0.0)
    assert np.allclose(outline[:4].mean(axis=0), position)
