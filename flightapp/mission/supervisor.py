"""Runs a mission beside the tasks it needs, and sees that whatever happens ends on the ground."""

import asyncio
import traceback
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any

from flightapp.autopilot.guard import CommandGuard
from flightapp.behaviors.base import Context
from flightapp.behaviors.coordinator import LETTING_GO, Coordinator
from flightapp.behaviors.emergency import come_to_rest, heard, land_until_down, piloted
from flightapp.channel import Reader
from flightapp.interfaces import Autopilot, AutopilotError
from flightapp.messages import Event, Outcome, Phase
from flightapp.mission.drone import BehaviorFailedError
from flightapp.mission.loader import MissionError
from flightapp.mission.orders import Orders
from flightapp.planning.caution import Caution
from flightapp.safety.faults import Fault, FaultKind, Reaction, Stage
from flightapp.safety.present import PresentFaults
from flightapp.safety.table import TABLE, reaction_to

LAST_WORDS = 1.0
"""s of recording after the motors are off: what the autopilot, or its link, still has to say, as of a reboot."""
MAY_FLY = frozenset(Phase) - {Phase.IDLE, Phase.PREFLIGHT, Phase.LANDED}


@dataclass(frozen=True, slots=True)
class Ending:
    """How a flight ended, and why in words."""

    outcome: Outcome
    reason: str


class ArmedAlreadyError(Exception):
    """The vehicle was armed before the mission began: somebody else flies it."""

    def __init__(self) -> None:
        super().__init__("the vehicle is armed, and not by this flight: let it land and disarm, then start again")


class Supervisor:
    """One flight: its tasks, its mission, and what is done about every fault, as `safety.table` says."""

    def __init__(self, context: Context, coordinator: Coordinator, guard: CommandGuard, caution: Caution) -> None:
        self._context, self._coordinator = context, coordinator
        self._guard = guard
        self._caution = caution
        self._faults = PresentFaults()
        self._decided: asyncio.Future[Fault] = asyncio.get_running_loop().create_future()
        self._holding: asyncio.TimerHandle | None = None
        self._suspended = False
        context.bus.fault.tap(self._hear)
        context.bus.phase.tap(lambda _: self._respond())
        context.bus.goal.tap(lambda _: self._respond())

    async def run(
        self,
        work: Mapping[str, Coroutine[Any, Any, None]],
        autopilot: Autopilot,
        mission: Callable[[], Awaitable[None]],
        orders: Orders,
    ) -> Ending:
        """Start ``work``, connect to the ``autopilot``, fly ``mission``; never raises for what they do.

        ``orders`` from outside, which must have been entered, may end it before.
        """
        running = [self._start(name, coroutine) for name, coroutine in work.items()]
        try:
            ending = await self._mission(autopilot, mission, orders)
            if self._may_fly():
                await self._abort(ending.reason, orders)
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
            self._context.bus.fault.publish(Fault(self._context.now(), FaultKind.TASK_FAILED, text))

    def _may_fly(self) -> bool:
        """Whether there is a flight to be seen to its end; also where the request to arm was not answered in time."""
        phase, status = self._context.machine.phase, self._context.autopilot.status.latest
        return phase in MAY_FLY or (phase is Phase.PREFLIGHT and status is not None and status.armed)

    # Faults and reactions.

    @property
    def _stage(self) -> Stage:
        return Stage.of(self._context.machine.phase)

    def _hear(self, fault: Fault) -> None:
        """Log ``fault``, which has begun or is over, and do what the table says."""
        if self._faults.take(fault):
            self._event(str(fault) if fault.over else f"{fault}; {reaction_to(fault.kind, self._stage)}")
            self._respond()

    def _respond(self) -> None:
        """Do what the gravest present fault calls for, here and now."""
        if self._decided.done():
            return
        reaction, fault = self._faults.gravest(self._stage)
        self._caution.held = str(fault) if reaction is Reaction.SLOW else ""
        if fault is not None and reaction is Reaction.HOLD:
            self._hold(fault)
        else:
            self._release()
        if fault is not None and reaction.final:
            self._decide(fault)

    def _hold(self, fault: Fault) -> None:
        """Stop along the line and wait, but not for ever."""
        if not (self._suspended or TABLE[fault.kind].stands):
            self._suspended = self._coordinator.suspend(str(fault))
        if self._holding is None:
            patience = self._context.config.safety.hold_time
            self._holding = asyncio.get_running_loop().call_later(patience, self._decide, fault)

    def _release(self) -> None:
        """Go on, where `_hold` had it stop."""
        if self._holding is not None:
            self._holding.cancel()
            self._holding = None
        if self._suspended:
            self._suspended = False
            self._coordinator.resume("the fault is over")

    def _decide(self, fault: Fault) -> None:
        """End the mission because of ``fault``."""
        if not self._decided.done():
            self._decided.set_result(fault)

    async def _mission(self, autopilot: Autopilot, mission: Callable[[], Awaitable[None]], orders: Orders) -> Ending:
        async def fly() -> None:
            await autopilot.connect()
            if (status := autopilot.status.latest) is not None and status.armed:
                raise ArmedAlreadyError
            await mission()

        if orders.stopped:
            return Ending(Outcome.INTERRUPTED, orders.stopped)
        interrupted = asyncio.create_task(orders.ended(), name="orders")
        flying = asyncio.create_task(fly(), name="mission")
        try:
            waited: set[asyncio.Future[Any]] = {flying, self._decided, interrupted}
            await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
            if flying.done():
                return _ending(flying)
            if self._decided.done():
                return Ending(Outcome.PROCESS_FAILURE, str(self._decided.result()))
            return Ending(Outcome.INTERRUPTED, interrupted.result())
        finally:
            # What ends from here on ends on the ground: nothing else is decided any more.
            self._decided.cancel()
            interrupted.cancel()
            flying.cancel()
            await self._coordinator.close()
            await asyncio.wait((flying,), timeout=LETTING_GO)

    # The end in flight.

    async def _abort(self, cause: str, orders: Orders) -> None:
        """Have the autopilot land, or leave it to whoever has taken over; end with the flight, not before."""
        context = self._context
        context.machine.go(Phase.ABORTED, context.now(), cause)
        if context.line.latest is not None and (
            why := await come_to_rest(context, lambda: self._faults.adrift or orders.aborted)
        ):
            self._event(f"it lands right here: {why}")
        context.line.clear()
        patience = context.config.mission.land_timeout
        try:
            async with asyncio.timeout(patience):
                await self._see_down()
            await asyncio.sleep(LAST_WORDS)
        except TimeoutError:
            self._event(f"landing not confirmed: not disarmed within {patience:g} s")
        except Exception as error:  # the autopilot's own failsafe is what is left
            self._event(f"landing not confirmed: {type(error).__name__}: {error}")

    async def _see_down(self) -> None:
        """Until the motors are off; the flight is recorded meanwhile."""
        status, left = Reader(self._context.autopilot.status), False
        await heard(self._context)
        while why := await land_until_down(self._context, self._hands_off, self._tipped):
            if not left:
                self._event(f"{why}: nothing is asked of the autopilot until it has disarmed")
            left = True
            await status.newest()

    def _hands_off(self) -> str:
        """Why nothing may be asked of the autopilot; empty where it may."""
        taken = self._guard.taken_over or self._faults.gravest(Stage.LANDING)[0] is Reaction.HAND_BACK
        return piloted(self._context) or ("the vehicle was taken over" if taken else "")

    def _tipped(self) -> bool:
        return self._faults.gravest(Stage.LANDING)[0] is Reaction.KILL

    def _event(self, text: str) -> None:
        self._context.bus.event.publish(Event(self._context.now(), "fault", text))


def _ending(flying: "asyncio.Task[None]") -> Ending:
    error = flying.exception()
    if error is None:
        return Ending(Outcome.GOAL_ACHIEVED, "mission complete")
    if isinstance(error, BehaviorFailedError):
        return Ending(error.result.outcome, str(error))
    if isinstance(error, MissionError | ArmedAlreadyError | AutopilotError):
        return Ending(Outcome.PROCESS_FAILURE, str(error))
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = f"{place.filename}:{place.lineno}: {type(error).__name__}: {error}"
    return Ending(Outcome.PROCESS_FAILURE, text)
