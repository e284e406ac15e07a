"""The race line's equations, against differences and dense algebra."""

import math

import numpy as np
import pytest

from flightapp.planning.race_blocks import factorise, solve
from flightapp.planning.race_problem import AT_KNOT, CLEARANCE, KINDS, PLACES, Problem, evaluate, measure
from flightapp.planning.race_samples import DURATION, FINE, KNOT, SAMPLES
from flightapp.planning.race_smooth import bend
from flightapp.planning.race_system import assemble
from flightapp.planning.race_work import Store

SEGMENTS = 4
CYLINDER = np.array([[1.0, 0.3, -0.2, 0.1, 1.1, 1.0, 0.0, 0.4, 0.0, 1.0, 0.0, 0.5]])
"""As `obstacles.packed` makes it: kind, centre, ball, cosine, sine, half sizes, owner, margin."""


def random_line(rng):
    line = rng.normal(size=(SEGMENTS + 1, KNOT))
    line[:, 6:9] *= 3.0
    line[:, 9:12] *= 10.0
    line[:, DURATION] = rng.uniform(0.4, 0.8, SEGMENTS + 1)
    return line


def some_problem(rng, drag, obstacle=False):
    n = SEGMENTS
    active = np.ones(KINDS + 3)
    active[CLEARANCE] = obstacle
    row = [1 / 9.0, 1 / 400.0, 1 / 27.0**2, 1 / 36.0, 1.0, math.cos(1.0), 0.2, 0.0]
    fixed, normals, planes = np.zeros((n + 1, KNOT)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    areas = np.zeros((n + 1, 3, 3))
    fixed[n, DURATION] = 1.0
    normals[2], areas[2] = (1.0, 0.0, 0.0), np.diag([0.0, 4.0, 9.0])
    planes[2] = 3.0 * normals[2]
    rows = CYLINDER if obstacle else np.zeros((0, CYLINDER.shape[1]))
    centres = rng.normal(size=(n + 1, 3))
    limits = np.tile(row, (n, 1))
    return Problem(
        active, limits, np.full(n, 0.05), math.cos(0.4), 1e-3, fixed, centres, areas, normals, planes, rows, drag
    )


def wanted(problem):
    """(n + 1, PLACES) 1 for the inequalities that count."""
    row = np.concatenate((np.repeat(problem.active[:KINDS], SAMPLES), problem.active[KINDS:]))
    out = np.tile(row, (SEGMENTS + 1, 1))
    out[-1, : AT_KNOT + 1] = 0.0
    return out


def inequalities(line, problem):
    work = Store().room(SEGMENTS)
    cost = evaluate(line, problem, work.ends, work.samples, work.near, work.c)
    return cost, work.c


def steps(line, size=1e-6):
    """Lines with one variable moved to either side; the last duration is none."""
    for place in range(line.size - 1):
        change = np.zeros(line.size)
        change[place] = size
        change = change.reshape(line.shape)
        yield line + change, line - change, 2.0 * size


def dense(diagonal, below):
    size = KNOT * (SEGMENTS + 1)
    matrix = np.zeros((size, size))
    for k in range(SEGMENTS + 1):
        at = slice(KNOT * k, KNOT * (k + 1))
        lower = np.tril(diagonal[k])
        matrix[at, at] = lower + np.tril(lower, -1).T
        if k < SEGMENTS:
            after = slice(KNOT * (k + 1), KNOT * (k + 2))
            matrix[after, at], matrix[at, after] = below[k], below[k].T
    return matrix


@pytest.mark.parametrize("drag", [0.0, 0.4])
@pytest.mark.parametrize("obstacle", [False, True])
def test_the_right_hand_side_is_the_lagrangians_gradient(drag, obstacle):
    rng = np.random.default_rng(1)
    line, problem = random_line(rng), some_problem(rng, drag, obstacle)
    duals = rng.uniform(0.0, 1.0, (SEGMENTS + 1, PLACES)) * wanted(problem)
    work = Store().room(SEGMENTS)
    work.dual[:], work.slack[:] = duals, 1e12
    evaluate(line, problem, work.ends, work.samples, work.near, work.c)
    assemble(line, problem, 0.0, work)

    def lagrangian(at):
        cost, c = inequalities(at, problem)
        return cost + float((duals * c).sum())

    expected = [(lagrangian(after) - lagrangian(before)) / size for after, before, size in steps(line)]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(-work.right.ravel()[:-1], expected, atol=1e-6 * scale)


@pytest.mark.parametrize("drag", [0.0, 0.4])
def test_the_matrix_is_the_sum_of_the_gradients_squares(drag):
    rng = np.random.default_rng(2)
    line, problem = random_line(rng), some_problem(rng, drag)._replace(smooth=0.0, planes=np.zeros((SEGMENTS + 1, 3)))
    counted, work = wanted(problem), Store().room(SEGMENTS)
    work.dual[:], work.slack[:] = 1e-9 * counted, 1e-9  # ratio 1, and too small for second derivatives to count
    evaluate(line, problem, work.ends, work.samples, work.near, work.c)
    assemble(line, problem, 0.0, work)
    rows = []
    for after, before, size in steps(line):
        change = inequalities(after, problem)[1] - inequalities(before, problem)[1]
        rows.append((change * counted).ravel() / size)
    gradients = np.array(rows)
    expected = gradients @ gradients.T
    found = dense(work.diagonal, work.below)[:-1, :-1]
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_block_solution_is_that_of_dense_algebra():
    rng = np.random.default_rng(3)
    factors = rng.normal(size=(SEGMENTS, KNOT, 2 * KNOT, 2 * KNOT))[:, 0]
    diagonal, below = np.zeros((SEGMENTS + 1, KNOT, KNOT)), np.zeros((SEGMENTS, KNOT, KNOT))
    for k, factor in enumerate(factors):
        part = factor @ factor.T + np.eye(2 * KNOT)
        diagonal[k] += part[:KNOT, :KNOT]
        diagonal[k + 1] += part[KNOT:, KNOT:]
        below[k] = part[KNOT:, :KNOT]
    right = rng.normal(size=(SEGMENTS + 1, KNOT))
    expected = np.linalg.solve(dense(diagonal, below), right.ravel())
    assert factorise(diagonal, below)
    solve(diagonal, below, right)
    np.testing.assert_allclose(right.ravel(), expected, rtol=1e-8)


def test_a_matrix_that_is_not_definite_is_noticed():
    diagonal = np.tile(np.eye(KNOT), (2, 1, 1))
    diagonal[1, 3, 3] = -1.0
    assert not factorise(diagonal, np.zeros((1, KNOT, KNOT)))


def test_a_bent_line_moves_its_anchors_and_keeps_the_motion_at_its_ends():
    rng = np.random.default_rng(4)
    line = random_line(rng)
    bent, moves = line.copy(), np.array([[0.0, 0.0, 0.0], [0.1, -0.2, 0.3], [0.0, 0.5, 0.0]])
    bend(bent, np.array([0, 2, 4]), moves, np.zeros((3, 3)))
    np.testing.assert_allclose(bent[[0, 2, 4], :3] - line[[0, 2, 4], :3], moves, atol=1e-12)
    np.testing.assert_allclose(bent[[0, 2, 4], 3:], line[[0, 2, 4], 3:], atol=1e-12)
    change = bent[[1, 3], :3] - line[[1, 3], :3]
    assert (np.abs(change) <= np.abs(moves).max(axis=0) + 1e-12).all()
    assert np.abs(bent[[1, 3], 3:6] - line[[1, 3], 3:6]).max() > 1e-3


def test_a_bent_line_begins_with_another_motion():
    rng = np.random.default_rng(6)
    line, begun = random_line(rng), rng.normal(size=(3, 3))
    bent = line.copy()
    bend(bent, np.array([0, 4]), np.zeros((2, 3)), begun)
    np.testing.assert_allclose(bent[0, 3:12] - line[0, 3:12], begun.ravel(), atol=1e-9)
    np.testing.assert_allclose(bent[[0, 4], :3], line[[0, 4], :3], atol=1e-12)
    np.testing.assert_allclose(bent[4], line[4], atol=1e-9)


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_a_straight_line_is_measured_exactly(speed):
    rng = np.random.default_rng(5)
    problem = some_problem(rng, 0.5)
    line = np.zeros((SEGMENTS + 1, KNOT))
    line[:, 3], line[:, DURATION] = speed, 0.5
    line[:, 0], line[:, 2] = 0.5 * speed * np.arange(SEGMENTS + 1), 1.0
    work, (worst, sampled) = Store().room(SEGMENTS), np.empty((2, SEGMENTS, KINDS))
    measure(line, problem, FINE, work.ends, work.samples, worst, sampled)
    np.testing.assert_allclose(worst[:, 0], speed / 3.0, rtol=1e-9)
    np.testing.assert_allclose(worst[:, 2], math.hypot(9.80665, 0.5 * speed) / 27.0, rtol=1e-4)
    np.testing.assert_allclose(worst[:, 6], 0.2 - 1.0, rtol=1e-9)
