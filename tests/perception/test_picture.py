"""Corners of small markers, against markers that are drawn by area: finely, then averaged over each pixel."""

import numpy as np
import pytest

from flightapp.perception.edges import refine_corners
from flightapp.perception.picture import fit_picture

CODE = np.pad(np.array([[0.0, 1, 1, 0], [1, 0, 1, 1], [0, 1, 0, 0], [1, 1, 0, 1]]), 1)
FINE = 12
"""Parts of a pixel's side."""
SPREAD = 0.5
"""px, standard deviation of the lens's blur."""


def quad_of(side, rng):
    """Somewhere, turned, seen askew and a little in perspective."""
    square = side * (np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) - 0.5)
    skew = np.eye(2) + rng.uniform(-0.2, 0.2, (2, 2))
    return 23.0 + square @ skew + rng.uniform(0.0, 1.0, 2) + 0.02 * side * rng.uniform(-1.0, 1.0, (4, 2))


def drawn(quad, paper=0.16, ground=25.0, noise=0.0, shape=(48, 48), rng=None):
    """The marker on its ``paper``, so many sides wide around it, before a ``ground`` of that grey."""
    h, w = shape
    v, u = (np.mgrid[: h * FINE, : w * FINE] + 0.5) / FINE - 0.5
    rows = []
    for (x, y), (s, t) in zip(quad, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], strict=True):
        rows += [[x, y, 1, 0, 0, 0, -s * x, -s * y, -s], [0, 0, 0, x, y, 1, -t * x, -t * y, -t]]
    H = np.linalg.svd(np.array(rows, float))[2][-1].reshape(3, 3)
    s, t, one = H @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    s, t = (s / one).reshape(u.shape), (t / one).reshape(u.shape)
    n = len(CODE)
    i, j = (np.clip(np.floor(n * x).astype(int), 0, n - 1) for x in (s, t))
    light = np.where(CODE[j, i] > 0.5, 190.0, 45.0)
    outside = (np.minimum(s, t) < 0.0) | (np.maximum(s, t) > 1.0)
    light[outside] = 190.0
    light[(np.minimum(s, t) < -paper) | (np.maximum(s, t) > 1.0 + paper)] = ground
    knots = np.arange(-3 * FINE, 3 * FINE + 1) / FINE
    weights = np.exp(-0.5 * (knots / SPREAD) ** 2)
    weights /= weights.sum()
    for axis in range(2):
        light = np.apply_along_axis(np.convolve, axis, light, weights, "same")
    image = light.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
    if rng is not None:
        image += noise * rng.normal(size=shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def fitted(image, corners, code=CODE, black=45.0, white=190.0, blur=0.6):
    out = np.empty((4, 2))
    return fit_picture(image, corners, code, black, white, blur, out), out


@pytest.mark.parametrize("side", [9.0, 11.0, 14.0, 19.0])
def test_corners_are_where_they_are_drawn_whatever_stands_behind_the_paper(side):
    rng = np.random.default_rng(int(side))
    by_edges, by_picture = [], []
    for ground in (20.0, 90.0, 190.0):
        for _ in range(4):
            quad = quad_of(side, rng)
            image = drawn(quad, ground=ground, noise=1.5, rng=rng)
            edges = np.empty((4, 2))
            refine_corners(image, quad + rng.normal(0.0, 0.1, (4, 2)), len(CODE), edges)
            good, corners = fitted(image, edges)
            assert good
            by_edges.append(edges - quad)
            by_picture.append(corners - quad)
    rms = np.sqrt(np.mean(np.square(by_picture)))
    assert rms < 0.05
    assert rms < 0.4 * np.sqrt(np.mean(np.square(by_edges)))
    assert np.abs(np.mean(by_picture, axis=(0, 1))).max() < 0.02


def test_it_is_where_it_was_only_moved():
    rng = np.random.default_rng(3)
    quad = quad_of(12.0, rng)
    here, there = (fitted(drawn(quad + shift), quad + shift + 0.1)[1] for shift in (0.0, (0.4, -0.3)))
    np.testing.assert_allclose(there - here, np.broadcast_to((0.4, -0.3), (4, 2)), atol=0.02)


def test_brightness_contrast_and_blur_that_are_told_wrongly_do_little():
    quad = quad_of(12.0, np.random.default_rng(4))
    image = drawn(quad)
    good, corners = fitted(image, quad + 0.1, black=60.0, white=170.0, blur=0.75)
    assert good
    np.testing.assert_allclose(corners, quad, atol=0.08)


def test_another_code_or_a_picture_that_is_not_there_leaves_the_corners():
    quad = quad_of(12.0, np.random.default_rng(5))
    image = drawn(quad)
    flat = np.full((48, 48), 120, np.uint8)
    wrong = np.pad(1.0 - CODE[1:-1, 1:-1], 1)
    for picture, corners, code in (
        (flat, quad, CODE),
        (image, quad + 4.0, CODE),
        (image, quad - 18.0, CODE),
        (image, np.tile(quad[:1], (4, 1)), CODE),
        (image, quad, wrong),
    ):
        good, out = fitted(picture, corners, code)
        if not good:
            np.testing.assert_array_equal(out, corners)
        assert np.abs(out - corners).max() < 0.6
