"""The task between tracker, estimator and autopilot."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from fakes import FakeAutopilot, state, virtually

from flightapp import tasks
from flightapp.bus import Bus
from flightapp.messages import Phase, PoseSample


class Tracker:
    """One pose every 10 ms; ``before(count)`` is called before each."""

    def __init__(self, count, before):
        self._count, self._before = count, before

    async def poses(self):
        for count in range(self._count):
            self._before(count)
            await asyncio.sleep(0.01)
            yield PoseSample(float(count), np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0)), np.zeros(3), np.zeros(3), 3)

    def report(self):
        return ""


def passed_on(doubted, phases):
    """Which of 8 poses the autopilot gets where the state is in doubt after those ``doubted``, in ``phases``."""
    bus, autopilot = Bus(), FakeAutopilot()
    estimator = SimpleNamespace(
        on_imu=lambda sample: None,
        on_pose=lambda sample: replace(state(sample.stamp), doubt="test" if sample.stamp in doubted else ""),
    )

    def enter(count):
        if count in phases:
            bus.phase.publish(phases[count])

    rig = SimpleNamespace(autopilot=autopilot, tracker=Tracker(8, enter))
    virtually(tasks.estimation(rig, bus, estimator))
    return [int(sample.stamp) for sample in autopilot.poses]


def test_the_autopilot_gets_every_pose_but_those_that_leave_the_state_in_doubt():
    assert passed_on((), {}) == [0, 1, 2, 3, 4, 5, 6, 7]
    assert passed_on((2, 3), {0: Phase.FLYING}) == [0, 1, 4, 5, 6, 7]


def test_on_the_way_down_it_gets_none_any_more_until_that_is_over():
    assert passed_on((2, 3), {0: Phase.FLYING, 3: Phase.ABORTED}) == [0, 1]
    assert passed_on((2, 3), {0: Phase.LANDING, 6: Phase.LANDED}) == [0, 1, 6, 7]
