"""Down, whatever else is going on: by the autopilot's own landing, asked for until it answers or a pilot flies."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from flightapp.autopilot.guard import SETTLE
from flightapp.behaviors.base import Behavior, Context, Parameters, Result
from flightapp.behaviors.vertical import LANDING
from flightapp.channel import Reader
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, Event, FlightMode, Outcome, Phase

ASK_AGAIN = 1.0
"""s without news of the autopilot until the landing is asked for again."""
STOPPING = 6.0
"""s that coming to rest along the line, beyond what stands below, may take."""
LOOK = 0.02
"""s between looks at whether it goes well."""
COMMAND_AGE = 0.2
"""s, an older last command shows that none are sent any more."""
NEWS = 0.3
"""s that a landing waits at most for the autopilot's present mode: after a stall of the process a pilot may fly."""
PILOTED = frozenset(FlightMode) - LANDING - {FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD}
"""Modes that the application never asks for."""


class Emergency(Behavior[Parameters]):
    """Break everything off and land, until the motors are off or a pilot flies."""

    name = "emergency"
    phases = frozenset({Phase.ARMED, Phase.TAKEOFF, Phase.FLYING, Phase.LANDING, Phase.ABORTED})
    fresh = ()
    needs = ()
    priority = 100

    @property
    def timeout(self) -> float:
        """`mission.land_timeout`."""
        own = self.context.config.mission.land_timeout
        return own if self.parameters.timeout is None else self.parameters.timeout

    @property
    def leads_to(self) -> Phase:
        """Nothing follows it."""
        return Phase.ABORTED

    async def run(self) -> Result:
        """To rest, while that goes well; then no line any more, and land, again while nobody answers."""
        context = self.context
        context.machine.go(Phase.ABORTED, context.now(), "emergency")
        context.halt()
        await come_to_rest(context)
        context.line.clear()
        await heard(context)
        if why := await land_until_down(context, lambda: piloted(context)):
            return Result(Outcome.WRONG_PROGRESS, why)
        return Result(Outcome.GOAL_ACHIEVED, "disarmed")

    def stopped(self) -> None:
        """Nothing: the autopilot goes on landing."""


async def come_to_rest(context: Context, adrift: Callable[[], str] = lambda: "") -> str:
    """Let the line, which ends at rest, be flown to its end, unless ``adrift`` or anything else speaks against it.

    What that is, in words; empty where it rests.
    """
    give_up = context.now() + STOPPING
    while not context.line.at_rest(context.now()):
        if why := adrift() or _unsound(context):
            return why
        if context.now() > give_up:
            return f"not at rest within {STOPPING:g} s"
        await asyncio.sleep(LOOK)
    return ""


def _unsound(context: Context) -> str:
    """Why the line is not to be flown on; empty where all that it takes is there."""
    bus, now, status = context.bus, context.now(), context.autopilot.status.latest
    state, command = bus.state.latest, bus.command.latest
    if context.line.latest is None:
        return "no line is flown"
    if status is None or status.mode is not FlightMode.OFFBOARD or now - status.stamp > context.config.link.lost_after:
        return "the autopilot does not follow commands"
    if state is None or state.doubt or now - state.stamp > context.config.safety.state_timeout:
        return "there is no state to be trusted"
    if command is None or now - command.stamp > COMMAND_AGE:
        return "no commands are sent"
    return ""


async def land_until_down(
    context: Context, hands_off: Callable[[], str], tipped: Callable[[], bool] = lambda: False
) -> str:
    """Ask for the landing, again while nobody answers, until the motors are off or ``hands_off`` has a reason.

    Where it has ``tipped`` over its motors are stopped instead. Returns that reason; empty where the motors are off.
    """
    autopilot, status, landing = context.autopilot, Reader(context.autopilot.status), False
    while not down(autopilot.status.latest):
        if why := hands_off():
            return why
        if tipped():
            await _ask(context, autopilot.kill)
        elif not landing:
            # Asked for even if it lands already: where its failsafe does that, commands that come again undo it.
            landing = await _ask(context, autopilot.land)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(ASK_AGAIN):
                await status.newest()
    return ""


async def _ask(context: Context, what: Callable[[], Awaitable[None]]) -> bool:
    """Whether the autopilot does it; what it answers otherwise is logged."""
    try:
        await what()
    except AutopilotError as error:
        context.bus.event.publish(Event(context.now(), "fault", str(error)))
        return False
    return True


def piloted(context: Context) -> str:
    """That a pilot flies; empty where none does."""
    latest = context.autopilot.status.latest
    return f"a pilot flies: mode {latest.mode}" if latest is not None and latest.mode in PILOTED else ""


async def heard(context: Context) -> None:
    """Wait for what the autopilot says from now on, and not for what has been waiting for us."""
    begun, status = context.now(), Reader(context.autopilot.status)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(NEWS):
            while (await status.newest()).stamp < begun + SETTLE:
                pass


def down(status: AutopilotStatus | None) -> bool:
    """Whether the motors are known to be off."""
    return status is not None and not status.armed
