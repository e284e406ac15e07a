import math
import re
from pathlib import Path

import numpy as np
import pytest

from flightapp.inputs import BadInputError
from flightapp.track import Cylinder, GateShape, MarkedGate, MarkerLayout, Track, load_track

SHIPPED = sorted((Path(__file__).parent.parent / "missions" / "tracks").glob("*.toml"))

GOOD = """
name = "two"
finish = [6.0, 0.0, 1.0]

[start]
position = [0.0, 0.0, 0.0]

[gate]
layout = "top"

[[gates]]
id = 1
position = [2.0, 0.0, 1.5]
yaw_deg = 0.0
markers = [0]

[[gates]]
id = 2
position = [4.0, 0.0, 1.5]
yaw_deg = 90.0
markers = [7]

[[obstacles]]
name = "pillar"
centre = [3.0, 2.0, 1.0]
size = [0.5, 0.5, 2.0]

[[obstacles]]
name = "post"
base = [3.0, -2.0, 0.0]
radius = 0.2
height = 3.0
"""


def load(folder: Path, text: str) -> Track:
    path = folder / "track.toml"
    path.write_text(text, encoding="utf-8")
    return load_track(path)


def test_good_track_is_read(tmp_path: Path) -> None:
    track = load(tmp_path, GOOD)
    assert [gate.id for gate in track.gates] == [1, 2]
    assert track.gates[1].yaw == pytest.approx(0.5 * math.pi)
    assert track.finish == (6.0, 0.0, 1.0)
    assert track.uncertainty.horizontal == 0.0
    assert track.obstacles[0].name == "pillar"
    assert track.obstacles[1] == Cylinder(name="post", base=(3.0, -2.0, 0.0), radius=0.2, height=3.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[2.0, 0.0, 1.5]", "[nan, 0.0, 1.5]", "'gates.0.position.0' = nan: input should be a finite number"),
        ("[2.0, 0.0, 1.5]", "[2.0, inf, 1.5]", "'gates.0.position.1' = inf: input should be a finite number"),
        ("[2.0, 0.0, 1.5]", "[2.0, 0.0]", "'gates.0.position.2' is missing"),
        ("[2.0, 0.0, 1.5]", "[2.0, 0.0, 0.6]", "gate 1 is underground: its opening begins at z = -0.10 m"),
        ("yaw_deg = 90.0", "yaw_deg = nan", "'gates.1.yaw_deg' = nan: input should be a finite number"),
        ("yaw_deg = 90.0", 'yaw_deg = "north"', "'gates.1.yaw_deg' = 'north': input should be a valid number"),
        ("yaw_deg = 90.0\n", "", "'gates.1.yaw_deg' is missing"),
        ("yaw_deg = 90.0", "yaw_dg = 90.0", "unknown key 'gates.1.yaw_dg'; did you mean 'yaw_deg'?"),
        ("id = 2", "id = 1", "gate id 1 is used twice"),
        ("id = 2", "id = -2", "'gates.1.id' = -2: input should be greater than or equal to 0"),
        ("markers = [7]", "markers = [0]", "marker id 0 is used twice, on gates 1 and 2"),
        ("markers = [7]", "markers = [7, 8]", "gate 2 lists 2 markers, but the layout 'top' has 1"),
        ("markers = [7]", "markers = []", "gate 2 lists 0 markers, but the layout 'top' has 1"),
        ("markers = [7]", "markers = [50]", "gate 2 has marker id 50, but dictionary 4X4_50 goes from 0 to 49"),
        ("markers = [7]", "markers = [-1]", "gate 2 has marker id -1, but dictionary 4X4_50 goes from 0 to 49"),
        ('layout = "top"', 'layout = "corners"', "gate 1 lists 1 markers, but the layout 'corners' has 4"),
        ('layout = "top"', 'layout = "left"', "'gate.layout' = 'left': input should be 'top' or 'corners'"),
        ('layout = "top"', 'layuot = "top"', "unknown key 'gate.layuot'; did you mean 'layout'?"),
        ('layout = "top"', 'layout = "top"\nmarker_size = 0.5', "marker_size 0.5 m is wider than the border, 0.4 m"),
        ('layout = "top"', 'layout = "top"\ndictionary = "4X4_49"', "'gate.dictionary' = '4X4_49'"),
        ('layout = "top"', 'layout = "top"\nopening = nan', "'gate.opening' = nan"),
        ("[0.0, 0.0, 0.0]", "[0.0, 0.0, -1.0]", "the start is underground: z = -1.00 m"),
        ("size = [0.5, 0.5, 2.0]", "size = [0.5, 0.0, 2.0]", "'obstacles.0.size.1' = 0.0: input should be greater"),
        (
            'name = "post"',
            'name = "pillar"',
            "the obstacle name 'pillar' is used twice; give each obstacle its own name",
        ),
        (
            "[3.0, -2.0, 0.0]",
            "[4.1, -0.1, 0.0]",
            "the centre of gate 2 is inside the obstacle 'post'; move one of them",
        ),
        ("[3.0, -2.0, 0.0]", "[6.0, 0.1, 0.5]", "the finish is inside the obstacle 'post'"),
        ("[3.0, 2.0, 1.0]", "[0.2, 0.0, 0.5]", "the start is inside the obstacle 'pillar'"),
        ("radius = 0.2", "radius = 0.0", "'obstacles.1.radius' = 0.0: input should be greater than 0"),
        ("radius = 0.2", "radus = 0.2", "unknown key 'obstacles.1.radus'; did you mean 'radius'?"),
        ("height = 3.0\n", "", "'obstacles.1.height' is missing"),
        ("centre = [3.0", "center = [3.0", "unknown key 'obstacles.0.center'; did you mean 'centre'?"),
        ("finish = [6.0, 0.0, 1.0]", "finsh = [6.0, 0.0, 1.0]", "unknown key 'finsh'; did you mean 'finish'?"),
        ("[[gates]]", "[[gate", "not valid TOML"),
    ],
)
def test_bad_track_is_told_with_file_field_and_mend(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in GOOD
    with pytest.raises(BadInputError) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'track.toml'}: ")
    assert expected in str(caught.value)


UNPLACED = GOOD.replace("[[gates]]", "[[unplaced]]")
for told in ("position = [2.0, 0.0, 1.5]\n", "position = [4.0, 0.0, 1.5]\n", "yaw_deg = 0.0\n", "yaw_deg = 90.0\n"):
    UNPLACED = UNPLACED.replace(told, "")


def test_gates_whose_places_nobody_knows(tmp_path: Path) -> None:
    track = load(tmp_path, UNPLACED)
    assert track.gates == ()
    assert [(gate.id, gate.markers) for gate in track.passage] == [(1, (0,)), (2, (7,))]


def test_nothing_of_where_gates_are_is_left_when_their_places_are_taken_away(tmp_path: Path) -> None:
    track = load(tmp_path, GOOD + "\n[uncertainty]\nhorizontal = 2.0\n")
    told = track.without_places()
    assert told == load(tmp_path, UNPLACED)
    assert told.passage == tuple(MarkedGate(id=gate.id, markers=gate.markers) for gate in track.gates)
    assert all(type(gate) is MarkedGate for gate in told.passage)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("id = 2", "id = 1", "gate id 1 is used twice"),
        ("markers = [7]", "markers = [0]", "marker id 0 is used twice, on gates 1 and 2"),
        ("markers = [7]", "markers = [7]\nyaw_deg = 3.0", "unknown key 'unplaced.1.yaw_deg'"),
        (
            "[[obstacles]]",
            GOOD[GOOD.index("[[gates]]") :].split("\n\n", maxsplit=1)[0] + "\n\n[[obstacles]]",
            "of all gates or of none",
        ),
    ],
)
def test_bad_unplaced_gates_are_told(tmp_path: Path, old: str, new: str, expected: str) -> None:
    with pytest.raises(BadInputError, match=re.escape(expected)):
        load(tmp_path, UNPLACED.replace(old, new, 1))


def test_empty_track(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="the track is empty"):
        load(tmp_path, 'name = "nothing"\n[start]\nposition = [0.0, 0.0, 0.0]\n')


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"none\.toml: there is no such track file"):
        load_track(tmp_path / "none.toml")


@pytest.mark.parametrize("layout", list(MarkerLayout))
def test_markers_lie_within_the_border_and_keep_their_size(layout: MarkerLayout) -> None:
    shape = GateShape(layout=layout)
    corners = shape.marker_corners()
    assert corners.shape == (shape.marker_count, 4, 3)
    far = np.abs(corners[..., 1:]).max(axis=2)
    assert far.min() > 0.5 * shape.opening
    assert far.max() < 0.5 * shape.opening + shape.border
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    np.testing.assert_allclose(sides, shape.marker_size, atol=1e-12)


def test_markers_go_round_from_the_top_left_as_seen_on_approach() -> None:
    corners = GateShape(layout=MarkerLayout.CORNERS).marker_corners()
    centres = corners.mean(axis=1)
    np.testing.assert_array_equal(np.sign(centres[:, 1:]), [(1, 1), (-1, 1), (-1, -1), (1, -1)])
    first = corners[0] - centres[0]
    np.testing.assert_array_equal(np.sign(first[:, 1:]), [(1, 1), (-1, 1), (-1, -1), (1, -1)])


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_track_bears_its_files_name_and_starts_on_the_ground(path: Path) -> None:
    track = load_track(path)
    assert track.name == path.stem
    assert track.start.position[2] == 0.0
    assert track.finish is not None


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_gates_are_met_from_the_front(path: Path) -> None:
    track = load_track(path)
    before = np.array(track.start.position)
    for gate in track.gates:
        ahead = np.array((math.cos(gate.yaw), math.sin(gate.yaw), 0.0))
        assert (np.array(gate.position) - before) @ ahead > 0.4
        before = np.array(gate.position)


def test_start_of_a_race_faces_the_first_gate_or_looks_through_it() -> None:
    for path in SHIPPED:
        track = load_track(path)
        if track.gates:
            x, y, _ = np.subtract(track.gates[0].position, track.start.position)
            sights = math.atan2(y, x), track.gates[0].yaw
            assert min(abs(track.start.yaw - sight) for sight in sights) < 0.02


def test_lemniscate_lies_on_its_curve() -> None:
    track = load_track(next(path for path in SHIPPED if path.stem == "lemniscate"))
    points = np.array([(*track.start.position[:2], 1.5), *track.waypoints, track.finish])
    theta = np.linspace(0.0, 2.0 * math.pi, len(points))
    curve = np.stack((5.5 * np.sin(theta), 2.75 * np.sin(2.0 * theta), np.full_like(theta, 1.5)), axis=1)
    np.testing.assert_allclose(points, curve, atol=1e-4)
    assert len(points) == 21
