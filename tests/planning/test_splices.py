"""A thousand plans in flight that never jump: the navigator, the planner and the line without the application."""

from collections import Counter
from dataclasses import replace
from importlib.metadata import entry_points

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.interfaces import Limits, PlanningError
from flightapp.messages import Drift, GateEstimate, GateMap
from flightapp.planning.answer import Answerer
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line, SpliceError
from flightapp.planning.navigator import Navigator
from flightapp.planning.pacing import STEADY, paced
from flightapp.track import Gate, Start, Track
from flightapp.trajectory import hover

JUMP = 1e-6
TICK = 0.004
CONFIG = Config()
LOOP = [(9.5, -7, 1.5, 46), (12.5, 3, 3.5, 111), (3, 10, 4.5, 168), (-8, 7.5, 2.5, 220), (-12.5, -3, 1.5, 295)]
START = np.array((0.0, -10.0, 1.0))
GATES = tuple(
    Gate(id=i, position=row[:3], yaw_deg=row[3], markers=tuple(range(4 * i, 4 * i + 4))) for i, row in enumerate(LOOP)
)
TRACK = Track(name="loop", start=Start(position=tuple(START)), gates=GATES)


class Flight:
    """Flies a line tick by tick with random replans, and measures every takeover on both of its sides."""

    def __init__(self, planner, seed):
        self.rng = np.random.default_rng(seed)
        self.line, self.navigator = Line(), Navigator(CONFIG, TRACK)
        self.answerer = Answerer(CONFIG, planner, self.navigator.pacer)
        self.now, self.serial, self.goal, self.push = 0.0, 0, None, 0.0
        self.flown, self.accepted = None, []
        self.takeovers = self.in_motion = 0
        self.worst = Counter()
        self.refused = Counter()
        self.line.accept(hover(0.0, START, 0.0))

    def gate_map(self):
        """The gates, each seen somewhere else again."""
        gates = []
        for gate in GATES:
            shift = self.rng.normal(0.0, 0.15, 3)
            P = np.diag((self.rng.choice((0.05, 0.3)) ** 2,) * 3 + (0.01,))
            gates.append(GateEstimate(gate.id, np.array(gate.position) + shift, gate.yaw, P, 9, self.now))
        return GateMap(self.now, 1, tuple(gates), Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))))

    def new_goal(self):
        self.serial += 1
        first = self.rng.integers(5)
        ids = tuple(int(i) for i in (first + np.arange(self.rng.integers(3, 12))) % 5)
        v_max = self.rng.choice((3.0, 5.0, 8.0))
        end = START + self.rng.uniform((-3.0, -2.0, 0.0), (3.0, 2.0, 2.0))
        self.goal = Goal(end, Limits(v_max, 8.0, 3.0), ids, serial=self.serial)

    def fly_until(self, stamp):
        while self.now < stamp:
            coming = [accepted for accepted in self.accepted if accepted > self.now]
            self.now = min(self.now + TICK, *coming) if coming else self.now + TICK
            self.accepted = coming
            piece = self.line.at(self.now)
            if self.flown is not None and piece is not self.flown:
                self.measure(self.flown, piece)
            self.flown = piece

    def accept(self, trajectory):
        self.line.accept(trajectory)
        self.accepted.append(trajectory.stamp)

    def measure(self, old, new):
        assert new.stamp == self.now, "taken over at its stamp"
        left, right = old.sample(new.stamp - old.stamp), new.sample(0.0)
        for name in ("position", "velocity", "acceleration", "jerk", "yaw", "yaw_rate"):
            jump = float(np.abs(getattr(left, name) - getattr(right, name)).max())
            self.worst[name] = max(self.worst[name], jump)
        self.takeovers += 1
        self.in_motion += bool(np.linalg.norm(right.velocity) > 0.5)

    def replan(self):
        """One turn of the planning task; a plan in twenty comes too late."""
        gate_map = self.gate_map()
        request = self.navigator.request(self.now, self.goal, gate_map, self.line)
        if request is not None:
            try:
                choice = self.answerer.answer(self.goal, request, (), self.navigator.rate, self.rng.random() < 0.1)
                elapsed = 0.4 if self.rng.random() < 0.05 else self.rng.uniform(0.0, 0.1)
                self.navigator.took(elapsed)
                self.fly_until(self.now + elapsed)
                if detour := self.navigator.detour(self.goal, request, choice, self.line):
                    raise PlanningError(detour)
                self.accept(choice.flown)
                self.navigator.accepted(self.goal, request, choice)
            except SpliceError as error:
                self.refused["late" if "late" in str(error) else "jump"] += 1
            except PlanningError:
                self.refused["plan"] += 1
        change = self.navigator.repace(self.now, self.goal, gate_map, self.line, push=self.push)
        if change is not None:
            self.accept(change[0].flown)
            self.navigator.repaced(change[0])
            self.refused["paced"] += 1


REPLANS = {"polynomial": 1000}
"""Takeovers flown; with other planners, which take longer, a tenth of that."""


@pytest.fixture(params=[point.name for point in entry_points(group="flightapp.planners") if point.name != "optimal"])
def name(request):
    return request.param


@pytest.fixture
def planner(name):
    (point,) = entry_points(group="flightapp.planners", name=name)
    return point.load()(CONFIG)


def test_a_thousand_replans_never_jump(name, planner):
    flight, count = Flight(planner, 4), REPLANS.get(name, 100)
    while flight.takeovers < count:
        if flight.goal is None or flight.rng.random() < 0.03 or flight.line.at_rest(flight.now):
            flight.new_goal()
        flight.push = flight.rng.choice((0.0, 0.0, 0.0, 6.0))
        flight.replan()
        flight.fly_until(flight.now + flight.rng.uniform(0.02, 0.4))
        assert flight.now < 2.0 * count, f"only {flight.takeovers} takeovers: {flight.refused}"
    assert all(jump <= JUMP for jump in flight.worst.values()), flight.worst
    assert flight.in_motion > 0.7 * count
    assert flight.refused["late"] > 0
    assert flight.refused["paced"] > 0.02 * count
    assert flight.refused["jump"] == 0


def test_what_is_left_of_a_line_ends_in_a_hover(planner):
    flight = Flight(planner, 5)
    flight.new_goal()
    for _ in range(12):
        flight.replan()
        flight.fly_until(flight.now + 0.3)
    last = flight.line.latest
    flight.fly_until(flight.now + last.duration + 10.0)
    end = flight.line.at(flight.now).setpoint(flight.now)
    np.testing.assert_array_equal(end.velocity, 0.0)
    assert end.yaw_rate == 0.0
    before = last.sample(last.duration - 1e-9)
    np.testing.assert_allclose(before.velocity, 0.0, atol=1e-6)
    np.testing.assert_allclose(before.acceleration, 0.0, atol=1e-5)
    np.testing.assert_allclose(before.position, end.position, atol=1e-6)


def test_a_plan_for_another_motion_is_refused_and_the_old_line_flown_on(planner):
    flight = Flight(planner, 6)
    flight.new_goal()
    flight.replan()
    flight.fly_until(1.5)
    flying = flight.line.latest
    onward = paced(flying, 2.0, STEADY, flying.stamp + 2.0)
    with pytest.raises(SpliceError, match="its start does not match the line: position jumps by"):
        flight.line.accept(replace(onward, stamp=onward.stamp + 0.05))
    assert flight.line.latest is flying
    flight.line.accept(onward)
    assert flight.line.latest is onward
