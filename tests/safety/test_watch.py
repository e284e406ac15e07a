"""The readings say what the topics, the sender and the computer say."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fakes import FakeAutopilot, state

from flightapp.bus import Bus
from flightapp.frames import quat_from_euler
from flightapp.messages import Frame, Phase, PlanReport, Setpoint, Sightings
from flightapp.planning.line import Line
from flightapp.safety.faults import Stage
from flightapp.safety.watch import Watch
from flightapp.trajectory import hover


class World:
    """Everything that is watched, and what watches it."""

    def __init__(self):
        self.bus, self.line, self.autopilot = Bus(), Line(), FakeAutopilot()
        self.free, self.offset, self.error, self.looked = 5000.0, 100.0, "", 0
        self.ticker = SimpleNamespace(overruns=0)
        computer = SimpleNamespace(disk_free=self._disk, clock_offset=lambda: self.offset)
        self.watch = Watch(
            self.bus, self.autopilot, self.line, computer, self.ticker, 250.0, Path("run"), lambda: self.error, 0.0
        )

    def _disk(self, directory):
        assert directory == Path("run")
        self.looked += 1
        return self.free


def test_before_anything_is_known_nothing_is():
    readings = World().watch.readings(0.1)
    assert readings.stage is Stage.PREFLIGHT
    assert math.isnan(readings.state_age)
    assert readings.position is None
    assert not readings.commanded
    assert (readings.images, readings.image_age) == (0, pytest.approx(0.1))


def test_state_line_and_autopilot_are_read():
    world = World()
    tilted = replace(state(1.0, (1.0, 2.0, 3.0)), orientation=quat_from_euler(0.5, 0.0, 2.0), doubt="odd")
    world.bus.state.publish(replace(tilted, velocity=np.array((3.0, 4.0, 0.0))))
    zero = np.zeros(3)
    world.bus.setpoint.publish(Setpoint(1.0, np.array((1.0, 0.5, 3.0)), zero, zero, zero, 0.0, 0.0))
    world.line.accept(hover(0.9, np.array((1.0, 0.5, 3.0)), 0.0))
    world.bus.phase.publish(Phase.FLYING)
    world.autopilot._set(stamp=0.8, armed=True, battery=0.3)
    readings = world.watch.readings(1.05)
    assert readings.stage is Stage.FLYING
    assert readings.commanded
    assert readings.at_rest
    assert readings.state_age == pytest.approx(0.05)
    assert (readings.speed, readings.tilt) == (pytest.approx(5.0), pytest.approx(0.5))
    assert readings.line_error == pytest.approx(1.5)
    assert readings.doubt == "odd"
    assert (readings.charge, readings.armed) == (0.3, True)
    assert readings.status_age == pytest.approx(0.25)
    assert world.watch.readings(1.5).line_error == 0.0, "an old setpoint is not being flown"


def test_refused_plans_count_until_one_is_accepted():
    world, counts = World(), []
    for accepted in (False, False, True, False):
        world.bus.plan.publish(PlanReport(0.0, 0.0, accepted, ""))
        counts.append(world.watch.readings(0.1).plans_refused)
    assert counts == [1, 2, 0, 1]


def test_detection_lags_behind_the_camera():
    world = World()
    world.bus.frame.publish(Frame(1.0, 1, None))
    assert world.watch.readings(1.1).detection_lag == 0.0
    world.bus.sightings.publish(Sightings(0.4, 0, (), ()))
    readings = world.watch.readings(1.1)
    assert (readings.detection_lag, readings.image_age) == (pytest.approx(0.6), pytest.approx(0.1))


def test_missed_ticks_are_a_share_of_the_last_second():
    world = World()
    world.ticker.overruns = 50
    assert world.watch.readings(0.5).ticks_missed == 0.0
    assert world.watch.readings(1.0).ticks_missed == pytest.approx(0.2)
    assert world.watch.readings(1.5).ticks_missed == pytest.approx(0.2)
    assert world.watch.readings(2.0).ticks_missed == 0.0


def test_the_disk_is_looked_at_now_and_then_and_the_clock_each_time():
    world = World()
    moved = []
    for stamp, world.offset in ((0.0, 100.0), (0.05, 100.0), (0.1, 97.0), (0.15, 97.0)):
        moved.append(world.watch.readings(stamp).clock_moved)
    assert moved == [0.0, 0.0, -3.0, 0.0]
    assert world.looked == 1
    world.free, world.error = 1.0, "No space left"
    readings = world.watch.readings(0.6)
    assert (readings.disk_free, readings.log_error) == (1.0, "No space left")
