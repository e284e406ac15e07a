"""The mission state machine."""

import itertools

import pytest

from flightapp.channel import Topic
from flightapp.messages import Phase
from flightapp.mission.machine import NEXT, IllegalTransitionError, MissionMachine


def machine():
    phases, events = Topic("phase"), Topic("event")
    return MissionMachine(phases, events), phases, events


def test_a_flight_goes_through_its_phases_and_tells_why():
    m, phases, events = machine()
    log = []
    events.tap(log.append)
    order = (Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.FLYING, Phase.LANDING, Phase.LANDED, Phase.PREFLIGHT)
    for stamp, phase in enumerate(order):
        m.go(phase, float(stamp), f"cause {stamp}")
    assert phases.latest is Phase.PREFLIGHT
    assert [e.text for e in log][2] == "takeoff: cause 2"
    assert len(log) == len(order)


@pytest.mark.parametrize(("start", "target"), list(itertools.product(Phase, Phase)))
def test_only_what_is_declared_is_possible(start, target):
    m, _, _ = machine()
    m._phase = start
    if target is start or target is Phase.ABORTED or target in NEXT[start]:
        m.go(target, 0.0, "test")
        assert m.phase is target
    else:
        with pytest.raises(IllegalTransitionError, match=f"{target} can't follow {start}"):
            m.go(target, 0.0, "test")
        assert m.phase is start


def test_staying_is_not_logged():
    m, _, events = machine()
    m.go(Phase.PREFLIGHT, 0.0, "a")
    m.go(Phase.PREFLIGHT, 1.0, "b")
    assert events.count == 1
