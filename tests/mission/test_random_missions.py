"""Missions, faults and pilots as they may come: whatever happens, what must hold holds."""

import asyncio
import os
from dataclasses import dataclass

import numpy as np
from fakes import virtually
from hypothesis import HealthCheck, event, given, settings
from hypothesis import Phase as Step
from hypothesis import strategies as st
from light_world import LightWorld

from flightapp.behaviors.coordinator import Coordinator
from flightapp.messages import FlightMode, Phase
from flightapp.mission.drone import BehaviorFailedError, Drone
from flightapp.mission.orders import signalled
from flightapp.mission.supervisor import Supervisor
from flightapp.planning.geofence import Geofence

MISSIONS = int(os.environ.get("RANDOM_MISSIONS", "60"))
"""How many are flown."""
LONGEST = 400.0
"""s after which a flight must have ended."""

place = st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.floats(-2.0, 6.0))
places = st.lists(place, min_size=1, max_size=4).map(tuple)
behavior = st.one_of(
    st.tuples(st.just("takeoff"), st.just({})),
    st.tuples(st.just("land"), st.just({})),
    st.tuples(st.just("emergency"), st.just({})),
    st.tuples(st.just("hover"), st.fixed_dictionaries({"seconds": st.floats(0.1, 6.0)})),
    st.tuples(st.just("goto"), st.fixed_dictionaries({"point": place})),
    st.tuples(
        st.just("follow"), st.fixed_dictionaries({"waypoints": st.lists(place, min_size=1, max_size=4).map(tuple)})
    ),
    st.tuples(st.just("race"), st.just({"laps": 1, "finish": (24.0, 0.0, 1.5)})),
    st.tuples(st.just("search"), st.fixed_dictionaries({"gate_id": st.sampled_from((1, 2)), "seconds": st.just(5.0)})),
    st.tuples(st.just("sway"), st.just({"seconds": 5.0, "up": ((0.2, 0.5),)})),
)


@dataclass(frozen=True)
class Act:
    """What a mission does next: these behaviors at once, given up after some time if there is one."""

    behaviors: tuple
    patience: float | None
    careless: bool
    """Whether it goes on where one fails."""


acts = st.builds(
    Act,
    st.lists(behavior, min_size=1, max_size=2).map(tuple),
    st.one_of(st.none(), st.floats(0.0, 8.0)),
    st.booleans(),
)
happening = st.tuples(
    st.floats(0.0, 40.0), st.sampled_from(("pilot", "silent", "push", "refuse", "interrupt")), st.floats(0.05, 3.0)
)


class Watched(LightWorld):
    """Notes all that must not be."""

    def __init__(self, **settings_):
        super().__init__(**settings_)
        self.coordinator = Coordinator(self.context)
        self.taken_over = np.inf
        self.fence, self.furthest = Geofence.of(self.context.config.geofence), -np.inf
        self.wrong = []
        self._phases = []
        self.context.bus.phase.tap(self._phases.append)

    def _move(self, now):
        super()._move(now)
        self.furthest = max(self.furthest, self.fence.outside(self.place - self.push))

    def _send(self, command):
        super()._send(command)
        now = self.context.now()
        if now > self.taken_over + 1e-9:
            self.wrong.append(f"a command at {now:.3f}, after the pilot took over at {self.taken_over:.3f}")
        if sum(one.moves for one in self.coordinator.active) > 1:
            self.wrong.append(f"several hold the motion command: {[one.name for one in self.coordinator.active]}")

    async def happen(self, when, what, lasting):
        """One thing from outside."""
        await asyncio.sleep(when)
        if what == "pilot":
            status = self.autopilot.status.latest
            if status.armed:
                if status.mode is FlightMode.OFFBOARD:
                    self.taken_over = min(self.taken_over, self.context.now())
                self.autopilot._set(mode=FlightMode.POSITION)
                await asyncio.sleep(10.0 * lasting)
                self.place = np.array((*self.place[:2], 0.0))
                self.autopilot._set(armed=False, landed=True)
        elif what == "silent":
            self.silent = True
            await asyncio.sleep(lasting)
            self.silent = False
        elif what == "push":
            self.push = np.array((lasting, 0.0, 0.0))
            await asyncio.sleep(2.0)
            self.push = np.zeros(3)
        elif what == "refuse":
            self.autopilot.refuse = "land"
            await asyncio.sleep(lasting)
            self.autopilot.refuse = ""


async def act(drone, one):
    """Do it, as a mission would."""
    try:
        async with asyncio.timeout(one.patience):
            runs = [drone.run(name, **parameters) for name, parameters in one.behaviors]
            await asyncio.gather(*runs)
    except (BehaviorFailedError, TimeoutError):
        if not one.careless:
            raise


@settings(
    max_examples=MISSIONS,
    deadline=None,
    phases=[Step.explicit, Step.reuse, Step.generate],  # a failing one is told as it is: shrinking takes minutes
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(st.lists(acts, min_size=1, max_size=6), st.lists(happening, max_size=3))
def test_whatever_happens(mission, happenings):
    world = Watched(geofence__corners=((-10.0, -8.0), (26.0, 8.0)), geofence__floor=-0.5, geofence__ceiling=5.0)

    async def fly(drone):
        for one in mission:
            await act(drone, one)

    async def main():
        drone = Drone(world.context, world.coordinator, {})
        outside = [asyncio.create_task(world.happen(*one)) for one in happenings if one[1] != "interrupt"]
        work = {f"work {number}": coroutine for number, coroutine in enumerate(world.work())}
        async with asyncio.timeout(LONGEST):
            supervisor = Supervisor(world.context, world.coordinator, world.guard, world.caution)
            with signalled() as orders, orders:
                ending = await supervisor.run(work, world.autopilot, lambda: fly(drone), orders)
        for task in outside:
            task.cancel()
        await asyncio.gather(*outside, return_exceptions=True)
        return ending

    ending = virtually(main())
    event(str(ending.outcome))
    assert not world.wrong
    assert world.furthest <= world.context.config.geofence.margin
    assert world.coordinator.active == ()
    assert not world.autopilot.status.latest.armed
    assert world.context.machine.phase in (Phase.IDLE, Phase.LANDED, Phase.ABORTED)
