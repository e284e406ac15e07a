"""Runs a mission beside the tasks it needs, and sees that whatever happens ends on the ground."""

import asyncio
import contextlib
import signal
import threading
import traceback
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from flightapp.autopilot.guard import SETTLE, CommandGuard
from flightapp.behaviors.base import Context
from flightapp.channel import Reader
from flightapp.interfaces import Autopilot, AutopilotError
from flightapp.messages import AutopilotStatus, Event, FlightMode, Outcome, Phase
from flightapp.mission.drone import BehaviorFailedError
from flightapp.mission.loader import MissionError

ASK_AGAIN = 1.0
"""s without news of the autopilot until the landing is asked for again."""
NEWS = 0.3
"""s that a landing waits at most for the autopilot's present mode: after a stall of the process a pilot may fly."""
LAST_WORDS = 1.0
"""s of recording after the motors are off: what the autopilot, or its link, still has to say, as of a reboot."""
LANDING = frozenset({FlightMode.LAND, FlightMode.DESCEND})
PILOTED = frozenset(FlightMode) - LANDING - {FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD}
"""Modes that the application never asks for."""
MAY_FLY = frozenset(Phase) - {Phase.IDLE, Phase.PREFLIGHT, Phase.LANDED}


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
        interrupted: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        try:
            with _caught_signals(interrupted):
                ending = await self._mission(autopilot, mission, interrupted)
                if self._context.machine.phase in MAY_FLY:
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

    async def _mission(
        self, autopilot: Autopilot, mission: Callable[[], Awaitable[None]], interrupted: "asyncio.Future[str]"
    ) -> Ending:
        async def fly() -> None:
            await autopilot.connect()
            await mission()

        flying = asyncio.create_task(fly(), name="mission")
        fault = asyncio.create_task(self._context.bus.fault.next(), name="fault")
        try:
            waited: set[asyncio.Future[Any]] = {flying, fault, interrupted}
            await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
            if flying.done():
                return _ending(flying)
            if fault.done():
                return Ending(Outcome.PROCESS_FAILURE, fault.result().text)
            return Ending(Outcome.INTERRUPTED, interrupted.result())
        finally:
            for task in (flying, fault):
                task.cancel()
            await asyncio.gather(flying, fault, return_exceptions=True)

    async def _abort(self, cause: str) -> None:
        """Have the autopilot land, or leave it to whoever has taken over; end with the flight, not before."""
        context = self._context
        context.machine.go(Phase.ABORTED, context.now(), cause)
        context.line.clear()
        patience = context.config.mission.land_timeout
        try:
            async with asyncio.timeout(patience):
                if not self._guard.taken_over:
                    await self._land(context.autopilot)
                elif not _down(context.autopilot.status.latest):
                    self._event("the vehicle was taken over: nothing is asked of the autopilot until it has disarmed")
                await self._wait_for_the_end(context.autopilot)
            await asyncio.sleep(LAST_WORDS)
        except TimeoutError:
            self._event(f"landing not confirmed: not disarmed within {patience:g} s")
        except Exception as error:  # the autopilot's own failsafe is what is left
            self._event(f"landing not confirmed: {type(error).__name__}: {error}")

    async def _wait_for_the_end(self, autopilot: Autopilot) -> None:
        """Until the motors are off; the flight is recorded meanwhile."""
        status = Reader(autopilot.status)
        while not _down(autopilot.status.latest):
            await status.newest()

    async def _land(self, autopilot: Autopilot) -> None:
        """Ask for the landing, again while nobody answers, until the motors are off or a pilot flies."""
        await self._hear(autopilot)
        status, asked = Reader(autopilot.status), False
        while not _down(latest := autopilot.status.latest):
            if latest is not None and latest.mode in PILOTED:
                self._event(f"a pilot flies: mode {latest.mode}")
                return
            # Asked for even if it lands already: where its failsafe does that, commands that come again undo it.
            if not asked:
                try:
                    await autopilot.land()
                    asked = True
                except AutopilotError as error:
                    self._event(str(error))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(ASK_AGAIN):
                    await status.newest()

    async def _hear(self, autopilot: Autopilot) -> None:
        """Wait for what the autopilot says from now on, and not for what has been waiting for us."""
        begun, status = self._context.now(), Reader(autopilot.status)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(NEWS):
                while (await status.newest()).stamp < begun + SETTLE:
                    pass

    def _event(self, text: str) -> None:
        self._context.bus.event.publish(Event(self._context.now(), "fault", text))


@contextlib.contextmanager
def _caught_signals(interrupted: "asyncio.Future[str]") -> Iterator[None]:
    """Have the first SIGINT or SIGTERM resolve ``interrupted``; later ones change nothing: the landing goes on."""

    def caught(number: signal.Signals) -> None:
        if not interrupted.done():
            interrupted.set_result(f"interrupted by {number.name}")

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop, numbers = asyncio.get_running_loop(), (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    for number in numbers:
        loop.add_signal_handler(number, caught, number)
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            loop.remove_signal_handler(number)
            signal.signal(number, handler)


def _down(status: AutopilotStatus | None) -> bool:
    return status is not None and not status.armed


def _ending(flying: "asyncio.Task[None]") -> Ending:
    error = flying.exception()
    if error is None:
        return Ending(Outcome.GOAL_ACHIEVED, "mission complete")
    if isinstance(error, BehaviorFailedError):
        return Ending(error.result.outcome, str(error))
    if isinstance(error, MissionError):
        return Ending(Outcome.PROCESS_FAILURE, str(error))
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = f"{place.filename}:{place.lineno}: {type(error).__name__}: {error}"
    return Ending(Outcome.PROCESS_FAILURE, text)
