import math
from dataclasses import replace

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.frames import quat_from_yaw
from flightapp.mapping.absence import LOOKS, AbsenceWatch
from flightapp.messages import GateEstimate
from flightapp.track import Gate, Start, Track

TRACK = Track(
    name="one",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(Gate(id=7, position=(5.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3)),),
)
GATE = GateEstimate(7, np.array((5.0, 0.0, 1.5)), 0.0, 0.01 * np.eye(4), 9, 0.0)
LEVEL = quat_from_yaw(0.0)


def verdicts(count, gate=GATE, seen=False, position=(0.0, 0.0, 1.5), yaw=0.0):
    watch = AbsenceWatch(Config(), TRACK)
    return [watch.look(gate, seen, np.array(position), quat_from_yaw(yaw)) for _ in range(count)]


def test_a_gate_that_should_be_in_sight_is_missed_once():
    found = verdicts(2 * LOOKS - 1)
    assert found.index(True) == LOOKS - 1
    assert found.count(True) == 1


def test_a_gate_that_is_seen_now_and_then_is_there():
    watch = AbsenceWatch(Config(), TRACK)
    assert not any(watch.look(GATE, count % 15 == 0, np.array((0.0, 0.0, 1.5)), LEVEL) for count in range(100))


@pytest.mark.parametrize(
    "unseen",
    [
        {"position": (-5.0, 0.0, 1.5)},
        {"position": (4.0, 0.0, 1.5)},
        {"position": (10.0, 0.0, 1.5), "yaw": math.pi},
        {"yaw": 1.0},
        {"yaw": math.pi},
        {"gate": replace(GATE, yaw=1.2)},
        {"gate": replace(GATE, covariance=0.5 * np.eye(4))},
    ],
    ids=["far", "near", "from behind", "beside the image", "behind the camera", "oblique", "vague"],
)
def test_what_could_not_be_seen_is_not_missed(unseen):
    assert not any(verdicts(3 * LOOKS, **unseen))
