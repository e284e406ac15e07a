"""Looking for gates, and flying at a gate again: what the drone is told to do, without a world around it."""

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest
from fakes import TRACK, FakeAutopilot, make_context, stream_states, virtually

from flightapp.behaviors.coordinator import Coordinator
from flightapp.behaviors.race import Race
from flightapp.behaviors.search import Search
from flightapp.messages import Drift, GateEstimate, GateMap, Outcome, Phase, PlanReport
from flightapp.trajectory import hover

HOME = np.array((0.0, 0.0, 1.5))
FINISH = (24.0, 0.0, 1.5)


def airborne(**settings):
    context = make_context(FakeAutopilot(), **settings)
    context = replace(context, track=TRACK.without_places())
    for phase in (Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.FLYING):
        context.machine.go(phase, 0.0, "test")
    context.line.accept(hover(0.0, HOME, 0.0))
    context.bus.gate_map.publish(gate_map())
    return context


def gate_map(*places, sigma=0.05):
    P = np.diag((sigma**2, sigma**2, sigma**2, 0.01))
    gates = tuple(GateEstimate(i, np.array((x, 0.0, 1.5)), 0.0, P, 10, 0.0) for i, x in places)
    return GateMap(0.0, 1, gates, Drift(0.0, np.zeros(3), 0.0, np.zeros((4, 4))))


class Planning:
    """Answers waypoint goals at once with a second of rest at their end, or refuses them all."""

    def __init__(self, context, refuse=""):
        self.goals, self.refuse, self.context = [], refuse, context
        context.bus.goal.tap(self.goals.append)

    async def run(self):
        context = self.context
        while True:
            goal = await context.bus.goal.next()
            while goal.waypoints is not None:
                await asyncio.sleep(0.2)
                now = context.now()
                if not self.refuse:
                    context.line.clear()
                    context.line.accept(hover(now, goal.end, 0.0, duration=1.0))
                context.bus.plan.publish(PlanReport(now, 0.1, not self.refuse, self.refuse))
                if not self.refuse or context.bus.goal.latest is not goal:
                    break

    @property
    def places(self):
        return [goal.end for goal in self.goals if goal.waypoints is not None]


def fly(context, behavior, planning, *also, position=lambda t: tuple(HOME)):
    async def main():
        work = [asyncio.create_task(c) for c in (stream_states(context, position), planning.run(), *also)]
        await asyncio.sleep(0.05)
        try:
            return await Coordinator(context).run(behavior), context.now()
        finally:
            for task in work:
                task.cancel()

    return virtually(main())


async def appears(context, after, *places, **kind):
    await asyncio.sleep(after)
    context.bus.gate_map.publish(gate_map(*places, **kind))


def search(context, gate_id, seconds):
    """Beginning ahead."""
    return Search(context, gate_id=gate_id, ahead=0.0, seconds=seconds)


def test_a_gate_that_appears_during_the_first_turn_ends_the_search_at_once():
    context = airborne()
    planning = Planning(context)
    result, now = fly(context, search(context, 1, 100.0), planning, appears(context, 2.0, (1, 8.0)))
    assert result.outcome is Outcome.GOAL_ACHIEVED
    assert now == pytest.approx(2.0, abs=0.2)
    assert planning.places == []


def test_the_search_turns_all_round_first_and_then_widens_within_the_geofence():
    context = airborne(geofence__corners=((-9.0, -9.0), (9.0, 9.0)), geofence__floor=0.0, geofence__ceiling=5.0)
    planning = Planning(context)
    scans = []
    context.bus.trajectory.tap(lambda scan: scans.append((context.now(), scan)))
    result, _ = fly(context, search(context, 1, 120.0), planning)
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 1 was not found within 120 s" in result.reason
    yaw = scans[0][1].sample(np.linspace(0.0, scans[0][1].duration, 300)).yaw
    assert np.ptp(yaw) == pytest.approx(2.0 * math.pi, abs=0.01)
    far = [float(np.hypot(*place[:2])) for place in planning.places]
    assert len(far) == len(scans) - 1 > 5
    assert max(far) > min(far) + 2.0
    assert all(np.abs(place[:2]).max() < 9.0 and 0.0 < place[2] < 5.0 for place in planning.places)


def test_another_gate_does_not_end_the_search():
    context = airborne()
    result, now = fly(context, search(context, 1, 30.0), Planning(context), appears(context, 2.0, (2, 8.0)))
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert now > 30.0


def test_a_gate_known_roughly_is_looked_for_from_its_front_until_it_is_known_well():
    context = airborne()
    context.bus.gate_map.publish(gate_map((1, 12.0), sigma=1.5))
    planning = Planning(context)
    known = appears(context, 20.0, (1, 12.0))
    result, now = fly(context, search(context, 1, 100.0), planning, known)
    assert result.outcome is Outcome.GOAL_ACHIEVED
    assert now == pytest.approx(20.0, abs=0.2)
    assert planning.places[0] == pytest.approx((12.0 - context.config.race.standoff, 0.0, 1.5))


def test_places_that_cannot_be_reached_are_left_out():
    context = airborne()
    planning = Planning(context, refuse="something is in the way")
    result, _ = fly(context, search(context, 1, 40.0), planning)
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert len({tuple(place) for place in planning.places}) > 10


def test_a_race_searches_for_a_gate_and_then_goes_on():
    context = airborne()
    planning = Planning(context)
    race = Race(context, laps=1, finish=FINISH)
    events = []
    context.bus.event.tap(lambda event: events.append(event.text))

    async def main():
        run = asyncio.create_task(Coordinator(context).run(race))
        await asyncio.sleep(8.0)
        run.cancel()

    async def both():
        work = [asyncio.create_task(c) for c in (stream_states(context, lambda t: tuple(HOME)), planning.run())]
        work.append(asyncio.create_task(appears(context, 4.0, (1, 8.0))))
        await main()
        for task in work:
            task.cancel()

    virtually(both())
    assert any("gate 1 is searched for" in text for text in events)
    assert any("gate 1 found after" in text for text in events)
    assert planning.goals[-2].gate_ids == (1, 2)
    assert planning.goals[-2].serial != planning.goals[0].serial


def test_a_gate_that_was_missed_is_flown_at_again_from_its_front_before_the_race_is_given_up():
    context = airborne(race__attempts=2)
    context.bus.gate_map.publish(gate_map((1, 8.0), (2, 16.0)))
    planning = Planning(context)

    def twice_beside(t):
        return (4.0 * (t % 4.0), 1.2, 1.5)

    result, _ = fly(context, Race(context, laps=1, finish=FINISH), planning, position=twice_beside)
    assert result.outcome is Outcome.WRONG_PROGRESS
    assert "gate 1 missed by 1.20 m" in result.reason
    way = next(goal for goal in planning.goals if goal.waypoints is not None)
    assert way.end == pytest.approx((5.0, 0.0, 1.5))
    assert abs(way.waypoints[0][1]) > 2.0
