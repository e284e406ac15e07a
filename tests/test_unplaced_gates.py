"""Gates of which only the markers are known: seen and told apart as any others, and nothing of their places leaks."""

from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from flightapp.app import told
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Frame, MarkerDetection
from flightapp.mission.loader import load_mission
from flightapp.modules import find
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.planning.geofence import Geofence
from sim.survey import survey, true_gates

MISSIONS = Path(__file__).parent.parent / "missions"
UNKNOWN = sorted(MISSIONS.glob("*_unknown.py"))
DETECTORS = sorted({point.name for point in entry_points(group="flightapp.detectors")})


def read(path):
    mission = load_mission(path)
    return mission, load_config(None, mission.settings)


@pytest.mark.parametrize("path", UNKNOWN, ids=lambda path: path.stem)
def test_missions_with_unknown_gates_are_told_of_their_markers_only(path):
    mission, config = read(path)
    track = survey(told(mission.track, config), np.random.default_rng(1), exact=False)
    assert track.gates == ()
    assert [gate.id for gate in track.passage] == [gate.id for gate in mission.track.gates]
    assert not hasattr(track.passage[0], "position")
    assert "gates" not in track.model_dump(exclude_defaults=True)


@pytest.mark.parametrize("path", UNKNOWN, ids=lambda path: path.stem)
def test_the_whole_track_lies_within_the_geofence(path):
    mission, config = read(path)
    fence = Geofence.of(config.geofence)
    for place in (*(gate.position for gate in mission.track.gates), mission.track.start.position, mission.track.finish):
        assert fence.outside(np.array(place)) < 0.0


def test_gates_are_known_unless_a_mission_says_otherwise():
    mission, config = read(MISSIONS / "five_gates.py")
    assert told(mission.track, config) is mission.track


@pytest.mark.parametrize("name", DETECTORS)
def test_detectors_and_gate_poses_know_the_markers_of_unplaced_gates(name):
    mission, config = read(MISSIONS / "five_gates_unknown.py")
    track = told(mission.track, config)
    corners = np.array([(300.0, 200.0), (330.0, 200.0), (330.0, 230.0), (300.0, 230.0)])
    frame = Frame(0.0, 0, None, (MarkerDetection(5, corners),))
    found = find("detectors", name)(config, track).detect(frame, None)
    assert [marker.marker_id for marker in found] == [5]
    sightings = GatePoseSolver(config, track, config.camera.model()).solve(0.0, found)
    assert [sighting.gate_id for sighting in sightings] == [2]


def test_a_world_cannot_be_simulated_without_places():
    mission, _ = read(MISSIONS / "one_gate.py")
    with pytest.raises(BadInputError, match="does not say where its gates are"):
        true_gates(mission.track.without_places())
