import math

import numpy as np
import pytest

from flightapp.config import Config, load_config
from flightapp.estimation.fusion import FusionEstimator
from flightapp.inputs import BadInputError
from flightapp.mapping.map_file import mapped, read_map, write_map
from flightapp.mapping.register import GateRegister
from flightapp.messages import GateEstimate
from flightapp.track import Gate, Start, Track, Uncertainty

TRACK = Track(
    name="two",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(
        Gate(id=1, position=(5.0, 0.0, 1.5), yaw_deg=10.0, markers=(0, 1, 2, 3)),
        Gate(id=2, position=(9.0, 4.0, 1.5), yaw_deg=90.0, markers=(4, 5, 6, 7)),
    ),
    uncertainty=Uncertainty(horizontal=3.0, vertical=0.5, yaw_deg=10.0),
)
SEEN = GateEstimate(1, np.array((5.4, 0.2, 1.6)), 0.2, np.diag((0.01, 0.04, 0.0025, 0.0004)), 30, 12.0)
UNSEEN = GateEstimate(2, np.array((9.1, 4.0, 1.5)), 1.5, np.eye(4), 0, -math.inf)


def test_a_map_says_of_each_gate_how_well_it_is_known(tmp_path):
    track = mapped(TRACK, (SEEN, UNSEEN))
    assert track is not None
    write_map(tmp_path / "map.toml", track)
    found = read_map(tmp_path / "map.toml", TRACK)
    assert found.gates[0].position == pytest.approx((5.4, 0.2, 1.6))
    assert found.gates[0].yaw == pytest.approx(0.2)
    assert found.gates[1] == TRACK.gates[1]
    register = GateRegister(Config(), found)
    assert register.gates[0].deviations == pytest.approx((0.2, 0.2, 0.05, 0.02))
    assert register.gates[1].deviations == pytest.approx(
        (1.5, 1.5, 0.5 / math.sqrt(3.0), math.radians(10.0) / math.sqrt(3.0))
    )
    assert [gate.surveyed for gate in register.gates] == [True, False]


def test_gates_that_were_unknown_are_known_after_they_were_found(tmp_path):
    unplaced = TRACK.without_places()
    assert mapped(unplaced, (SEEN,)) is None
    track = mapped(unplaced, (SEEN, GateEstimate(2, np.array((8.0, 4.0, 1.4)), 1.4, 0.01 * np.eye(4), 9, 10.0)))
    assert track is not None
    write_map(tmp_path / "map.toml", track)
    found = read_map(tmp_path / "map.toml", unplaced)
    assert [gate.id for gate in found.gates] == [1, 2]
    assert found.unplaced == ()


def test_a_map_of_another_track_is_refused(tmp_path):
    write_map(tmp_path / "map.toml", TRACK.model_copy(update={"gates": TRACK.gates[:1]}))
    with pytest.raises(BadInputError, match="gate 2 of track 'two' is not in this map"):
        read_map(tmp_path / "map.toml", TRACK)
    other = Gate(id=2, position=(9.0, 4.0, 1.5), yaw_deg=90.0, markers=(8, 9, 10, 11))
    write_map(tmp_path / "map.toml", TRACK.model_copy(update={"gates": (TRACK.gates[0], other)}))
    with pytest.raises(BadInputError, match="made on another track"):
        read_map(tmp_path / "map.toml", TRACK)
    with pytest.raises(BadInputError, match="no such track file"):
        read_map(tmp_path / "none.toml", TRACK)


def test_the_estimator_starts_from_the_map(tmp_path):
    track = mapped(TRACK, (SEEN, UNSEEN))
    assert track is not None
    estimator = FusionEstimator(load_config(), track)
    first, second = estimator.places()
    np.testing.assert_allclose(first.position, SEEN.position)
    assert np.sqrt(first.covariance[0, 0]) == pytest.approx(0.2)
    assert np.sqrt(second.covariance[0, 0]) == pytest.approx(1.5)
