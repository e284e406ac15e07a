import math

import numpy as np
import pytest

from sim.plant import Plant
from sim.vehicles import load_vehicle
from sim.wind import length_horizontal, length_vertical, update_gust, vertical_ratio

FOOT = 0.3048


def test_lengths_are_those_of_the_standard():
    assert length_vertical(200.0 * FOOT) == pytest.approx(200.0 * FOOT)
    assert length_horizontal(200.0 * FOOT) == pytest.approx(FOOT * 200.0 / (0.177 + 0.1646) ** 1.2)
    assert length_horizontal(1000.0 * FOOT) == pytest.approx(1000.0 * FOOT, rel=1e-6)
    assert length_horizontal(0.0) == length_horizontal(10.0 * FOOT)


@pytest.mark.parametrize("step", [0.05, 0.2])
def test_gusts_have_their_variance_and_correlation(step):
    rng = np.random.default_rng(7)
    height, speed, sigma = 3.0, 10.0, 1.5
    gust = tuple((sigma * rng.standard_normal(3)).tolist())
    noise = rng.standard_normal((150_000, 3))
    series = np.empty_like(noise)
    for i in range(len(noise)):
        gust = update_gust(gust, sigma, speed, height, tuple(noise[i].tolist()), step)
        series[i] = gust
    expected = sigma * np.array([1.0, 1.0, vertical_ratio(height)])
    assert series.std(axis=0) == pytest.approx(expected, rel=0.06)
    for axis, length in ((0, length_horizontal(height)), (2, length_vertical(height))):
        lag = round(length / speed / step)
        x = series[:, axis]
        correlation = np.mean(x[:-lag] * x[lag:]) / np.var(x)
        assert correlation == pytest.approx(math.exp(-lag * step * speed / length), abs=0.06)


def test_the_mean_wind_carries_the_vehicle_along():
    plant = Plant(load_vehicle("px4"), 5, wind=4.0, position=(0.0, 0.0, 500.0))
    assert np.linalg.norm(plant.mean_wind) == pytest.approx(4.0)
    assert plant.mean_wind[2] == 0.0
    plant.advance(8.0)
    assert plant.velocity[:2] == pytest.approx(plant.mean_wind[:2], rel=1e-3)


def test_without_gusts_the_air_is_steady():
    plant = Plant(load_vehicle("px4"), 5, position=(0.0, 0.0, 50.0))
    plant.advance(1.0)
    assert np.array_equal(plant.wind, np.zeros(3))
