"""Runs a mission beside the tasks it needs, and sees that whatever happens ends on the ground."""

import asyncio
import traceback
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any

from flightapp.autopilot.guard import CommandGuard
from flightapp.behaviors.base import Context
from flightapp.channel import Reader
from flightapp.interfaces import Autopilot
from flightapp.messages import Event, Outcome, Phase
from flightapp.mission.drone import BehaviorFailedError

AIRBORNE = frozenset({Phase.ARMED, Phase.TAKEOFF, Phase.FLYING, Phase.LANDING})


@dataclass(frozen=True, slots=True)
class Ending:
    """How a flight ended, and why in words."""

    outcome: Outcome
    reason: str


class Supervisor:
    """One flight: its tasks, its mission, and the landing that every failure leads to."""

    def __init__(self, context: Context, guard: CommandGuard) -> None:
        self._context = context
        self._guard = guard

    async def run(
        self,
        work: Mapping[str, Coroutine[Any, Any, None]],
        autopilot: Autopilot,
        mission: Callable[[], Awaitable[None]],
    ) -> Ending:
        """Start ``work``, connect to the ``autopilot``, fly ``mission``; never raises for what they do."""
        running = [self._start(name, coroutine) for name, coroutine in work.items()]
        try:
            ending = await self._mission(autopilot, mission)
            if self._context.machine.phase in AIRBORNE:
                await self._abort(ending.reason)
            return ending
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)

    def _start(self, name: str, coroutine: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        task = asyncio.create_task(coroutine, name=name)
        task.add_done_callback(self._task_ended)
        return task

    def _task_ended(self, task: "asyncio.Task[None]") -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            place = traceback.extract_tb(error.__traceback__)[-1]
            text = f"task {task.get_name()} failed at {place.name}:{place.lineno}: {type(error).__name__}: {error}"
            self._context.bus.fault.publish(Event(self._context.now(), "fault", text))

    async def _mission(self, autopilot: Autopilot, mission: Callable[[], Awaitable[None]]) -> Ending:
        async def fly() -> None:
            await autopilot.connect()
            await mission()

        flying = asyncio.create_task(fly(), name="mission")
        fault = asyncio.create_task(self._context.bus.fault.next(), name="fault")
        try:
            await asyncio.wait({flying, fault}, return_when=asyncio.FIRST_COMPLETED)
            if not flying.done():
                return Ending(Outcome.PROCESS_FAILURE, fault.result().text)
            return _ending(flying)
        except asyncio.CancelledError:
            this = asyncio.current_task()
            if this is not None:
                this.uncancel()
            return Ending(Outcome.INTERRUPTED, "interrupted by a signal")
        finally:
            for task in (flying, fault):
                task.cancel()
            await asyncio.gather(flying, fault, return_exceptions=True)

    async def _abort(self, cause: str) -> None:
        """Have the autopilot land, unless a pilot has taken over."""
        context = self._context
        context.machine.go(Phase.ABORTED, context.now(), cause)
        context.line.clear()
        if self._guard.taken_over:
            return
        try:
            async with asyncio.timeout(context.config.mission.land_timeout):
                await context.autopilot.land()
                status = Reader(context.autopilot.status)
                while (latest := context.autopilot.status.latest) is None or latest.armed:
                    await status.newest()
        except Exception as error:  # the autopilot's own failsafe is what is left
            text = f"landing not confirmed: {type(error).__name__}: {error}"
            context.bus.event.publish(Event(context.now(), "fault", text))


def _ending(flying: "asyncio.Task[None]") -> Ending:
    error = flying.exception()
    if error is None:
        return Ending(Outcome.GOAL_ACHIEVED, "mission complete")
    if isinstance(error, BehaviorFailedError):
        return Ending(error.result.outcome, str(error))
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = f"{place.filename}:{place.lineno}: {type(error).__name__}: {error}"
    return Ending(Outcome.PROCESS_FAILURE, text)
