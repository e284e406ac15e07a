import numpy as np

from flightapp.estimation.recent import KEPT, RecentStates
from flightapp.messages import VehicleState


def a_state(stamp):
    zero = np.zeros(3)
    return VehicleState(stamp, zero, np.array((1.0, 0.0, 0.0, 0.0)), zero, zero, np.eye(9))


def test_the_state_of_an_exposure():
    states = RecentStates()
    assert states.at(1.0) is None
    for stamp in (1.0, 1.005, 1.01, 1.01, 1.007):
        states.add(a_state(stamp))
    assert [states.at(t).stamp for t in (0.5, 1.0, 1.004, 1.005, 1.009, 2.0)] == [1.0, 1.0, 1.0, 1.005, 1.005, 1.01]


def test_the_oldest_are_forgotten():
    states = RecentStates()
    for count in range(2 * KEPT):
        states.add(a_state(float(count)))
    assert states.at(0.0).stamp == KEPT
