"""A mission under its supervisor, in virtual time, with an autopilot that obeys at once."""

import asyncio
from contextlib import nullcontext
from types import SimpleNamespace

from fakes import FakeAutopilot, make_context, stream_states, virtually

from flightapp.behaviors.coordinator import Coordinator
from flightapp.mission.drone import Drone
from flightapp.mission.orders import signalled
from flightapp.mission.supervisor import Supervisor
from flightapp.planning.caution import Caution


def fly(mission, autopilot=None, work=None, taken_over=False, during=None, caution=None, orders=None):
    """The ending of ``mission``, its context and its autopilot; ``during(context)`` runs beside it."""
    autopilot = autopilot or FakeAutopilot()
    context = make_context(autopilot)

    async def main():
        coordinator = Coordinator(context)
        drone = Drone(context, coordinator, {})
        tasks = {"states": stream_states(context), **(work(context) if work else {})}
        beside = asyncio.create_task(during(context)) if during else None
        guard = SimpleNamespace(taken_over=taken_over)
        supervisor = Supervisor(context, coordinator, guard, caution or Caution(context.config))
        with signalled() if orders is None else nullcontext(orders) as given, given:
            ending = await supervisor.run(tasks, autopilot, lambda: mission(drone), given)
        if beside is not None:
            beside.cancel()
        return ending

    return virtually(main()), context, autopilot


async def up_and_down(drone):
    await drone.takeoff()
    await drone.hover(5.0)
    await drone.land()
