"""Obstacles as they are drawn."""

import numpy as np
import pytest
from synthetic_flight import flight, track

from flightapp.evaluation.figures import Subject, path_above, path_side
from flightapp.evaluation.metrics import Window
from flightapp.evaluation.solids import outline
from flightapp.evaluation.summary import flight_track
from flightapp.track import Box, Cylinder, Track

PILLAR = Cylinder(name="pillar", base=(1.0, -6.0, 0.5), radius=0.4, height=3.0)
WALL = Box(name="wall", centre=(4.0, 2.0, 1.0), size=(0.2, 3.0, 2.0))


def extent(points):
    return np.array((points.min(axis=0), points.max(axis=0)))


@pytest.mark.parametrize(
    ("obstacle", "axes", "expected"),
    [
        (PILLAR, (0, 1), ((0.6, -6.4), (1.4, -5.6))),
        (PILLAR, (0, 2), ((0.6, 0.5), (1.4, 3.5))),
        (PILLAR, (1, 2), ((-6.4, 0.5), (-5.6, 3.5))),
        (WALL, (0, 1), ((3.9, 0.5), (4.1, 3.5))),
        (WALL, (1, 2), ((0.5, 0.0), (3.5, 2.0))),
    ],
)
def test_outlines_are_closed_and_as_large_as_the_obstacle(obstacle, axes, expected):
    points = outline(obstacle, axes)
    np.testing.assert_allclose(points[0], points[-1], atol=1e-12)
    np.testing.assert_allclose(extent(points), expected, atol=1e-9)


def test_a_pillar_is_round_from_above():
    radii = np.linalg.norm(outline(PILLAR) - (1.0, -6.0), axis=1)
    np.testing.assert_allclose(radii, 0.4)
    assert len(radii) > 12


def test_reports_show_the_obstacles_of_the_flights_track():
    built = track().model_copy(update={"obstacles": (PILLAR, WALL)})
    flown = flight()
    flown.header["track"] = built.model_dump_json()
    read = flight_track(flown)
    assert isinstance(read, Track)
    assert read.obstacles == (PILLAR, WALL)
    subject = Subject(flown, Window(2.0, 12.0), read)
    for figure in (path_above(subject), path_side(subject)):
        names = [trace.name for trace in figure.data]
        assert names[:2] == ["pillar", "wall"]
    bare = Subject(flown, Window(2.0, 12.0), None)
    assert "pillar" not in [trace.name for trace in path_above(bare).data]
