"""Leaving the ground and coming back to it, by the autopilot's own means."""

import asyncio
import contextlib
import math

import numpy as np
from pydantic import Field

from flightapp.behaviors.base import Behavior, Context, Parameters, Result
from flightapp.channel import Reader
from flightapp.config.fields import Finite
from flightapp.frames import Vector
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus, FlightMode, Outcome, Phase
from flightapp.trajectory import hover

CLIMBED = 0.5
"""Share of the takeoff height above which a hover is the climb's end. Where that is depends on the autopilot: PX4
v1.16 counts the height from the origin of its local frame, and not from the ground."""
STEADY = 0.25
"""m/s, vertical speed of a hover."""
STEADY_TIME = 0.7
"""s"""
HEARD_AGAIN = 1.0
"""s for which an autopilot that was silent must be heard before anything is asked of it."""
ARM_PATIENCE = 8.0
"""s during which arming is tried again."""
ARM_AGAIN = 0.5
"""s between two attempts."""


LANDING = frozenset({FlightMode.LAND, FlightMode.DESCEND})
"""The autopilot's modes in which it lands."""


class TakeoffParameters(Parameters):
    """How high."""

    height: Finite | None = Field(
        None, ge=0.3, le=20.0, description="m above the ground; default: mission.takeoff_height"
    )


class Takeoff(Behavior[TakeoffParameters]):
    """Arm, climb and hand the motion over to the application.

    Ends with the application in command (offboard), hovering where the climb ended.
    """

    name = "takeoff"
    accepts = TakeoffParameters
    phases = frozenset({Phase.IDLE, Phase.LANDED})
    fresh = ()
    needs = ()

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        asked = self.parameters.height
        self._height = context.config.mission.takeoff_height if asked is None else asked
        self._ground = 0.0

    @property
    def timeout(self) -> float:
        """`mission.takeoff_timeout`."""
        own = self.context.config.mission.takeoff_timeout
        return own if self.parameters.timeout is None else self.parameters.timeout

    @property
    def progress(self) -> float:
        """Of the climb."""
        state = self.context.bus.state.latest
        climbing = self.context.machine.phase in (Phase.TAKEOFF, Phase.FLYING)
        return (float(state.position[2]) - self._ground) / self._height if climbing and state is not None else 0.0

    @property
    def destination(self) -> Vector:
        """Above the start."""
        x, y, z = self.context.track.start.position
        return np.array((x, y, z + self._height))

    @property
    def leads_to(self) -> Phase:
        """Flight."""
        return Phase.FLYING

    def refusal(self) -> str:
        """Also where the vehicle is armed already: then somebody flies it."""
        armed = self._is_armed()
        return super().refusal() or ("takeoff needs a disarmed vehicle, but it is armed" if armed else "")

    async def run(self) -> Result:
        """Ready → takeoff mode → armed → at the height → offboard."""
        autopilot, machine = self.context.autopilot, self.context.machine
        machine.go(Phase.PREFLIGHT, self.context.now(), "takeoff asked for")
        status = Reader(autopilot.status)
        await self._wait_until_ready(status)
        ground = self.context.bus.state.latest or await self.context.bus.state.next()
        self._ground = float(ground.position[2])
        self.context.release_guard()
        await autopilot.takeoff(self._height)
        await self._arm()
        machine.go(Phase.ARMED, self.context.now(), "the autopilot is ready")
        machine.go(Phase.TAKEOFF, self.context.now(), f"to {self._height:g} m")
        left = await self._climb(status, self._ground)
        if left is not None:
            return Result(Outcome.WRONG_PROGRESS, f"the autopilot left the climb before its end: {left}")
        await self._take_command()
        machine.go(Phase.FLYING, self.context.now(), "the climb is over")
        here = self.context.bus.state.latest or ground
        return Result(Outcome.GOAL_ACHIEVED, f"hovering {here.position[2] - self._ground:.1f} m above the ground")

    def stopped(self) -> None:
        """What all do; before anything is armed, the mission is where it was."""
        super().stopped()
        if self.context.machine.phase is Phase.PREFLIGHT:
            target = Phase.ARMED if self._is_armed() else Phase.IDLE
            self.context.machine.go(target, self.context.now(), "the takeoff was broken off")

    async def _wait_until_ready(self, status: Reader[AutopilotStatus]) -> None:
        """Until the autopilot has a position, and has been heard for a while where it was silent."""
        lost = self.context.config.link.lost_after
        while True:
            latest = self.context.autopilot.status.latest
            silent = latest is not None and self.context.now() - latest.stamp > lost
            if latest is not None and latest.ready and not silent:
                return
            await status.newest()
            if silent:
                await asyncio.sleep(HEARD_AGAIN)

    def _is_armed(self) -> bool:
        status = self.context.autopilot.status.latest
        return status is not None and status.armed

    async def _arm(self) -> None:
        """Arm; the autopilot's checks may take a moment to notice that the position has become good."""
        give_up = self.context.now() + ARM_PATIENCE
        while True:
            try:
                return await self._arm_once()
            except AutopilotError:
                await asyncio.sleep(ARM_AGAIN)
                if self._is_armed():  # it has obeyed, and only its answer was lost
                    return None
                if self.context.now() > give_up:
                    raise

    async def _arm_once(self) -> None:
        arming = asyncio.ensure_future(self.context.autopilot.arm())
        try:
            await asyncio.shield(arming)
        except asyncio.CancelledError:
            # The autopilot may obey all the same: whoever sees to the end must know whether it has.
            with contextlib.suppress(AutopilotError):
                await arming
                self.context.machine.go(Phase.ARMED, self.context.now(), "armed as the takeoff was broken off")
            raise

    async def _climb(self, status: Reader[AutopilotStatus], ground: float) -> str | None:
        """Wait until the climb is over; what broke it off, or None.

        It is over when the autopilot holds, or, since PX4 can't hold without a global position and then stays in its
        takeoff mode, when it hovers well above the ground.
        """
        climbing, steady_since = False, math.inf
        while True:
            latest = await status.newest()
            climbing |= latest.armed and latest.mode is FlightMode.TAKEOFF
            if climbing and not latest.armed:
                return "it has disarmed"
            if climbing and latest.mode is FlightMode.HOLD:
                return None
            if climbing and latest.mode is not FlightMode.TAKEOFF:
                return f"its mode is {latest.mode}"
            state, now = self.context.bus.state.latest, self.context.now()
            up = state is not None and state.position[2] - ground > CLIMBED * self._height
            if state is None or not up or latest.landed or abs(state.velocity[2]) > STEADY:
                steady_since = math.inf
            steady_since = min(steady_since, now)
            if up and now - steady_since > STEADY_TIME:
                return None

    async def _take_command(self) -> None:
        """Stream commands for a hover right here, then have the autopilot follow them."""
        bus = self.context.bus
        state = await bus.state.next()
        track_yaw = self.context.track.start.yaw
        self.context.line.clear()
        trajectory = hover(state.stamp, state.position, track_yaw)
        self.context.line.accept(trajectory)
        bus.trajectory.publish(trajectory)
        for _ in range(5):
            await bus.command.next()
        await self.context.autopilot.start_offboard()


class Land(Behavior[Parameters]):
    """Land here and disarm, as the autopilot does."""

    name = "land"
    phases = frozenset({Phase.ARMED, Phase.TAKEOFF, Phase.FLYING, Phase.LANDING, Phase.ABORTED})
    fresh = ()
    needs = ()
    priority = 80

    def __init__(self, context: Context, **parameters: object) -> None:
        super().__init__(context, **parameters)
        self._from = math.nan

    @property
    def timeout(self) -> float:
        """`mission.land_timeout`."""
        own = self.context.config.mission.land_timeout
        return own if self.parameters.timeout is None else self.parameters.timeout

    @property
    def progress(self) -> float:
        """Of the way down to the track's start."""
        state, ground = self.context.bus.state.latest, self.context.track.start.position[2]
        if state is None or not self._from > ground:
            return 0.0
        return (self._from - float(state.position[2])) / (self._from - ground)

    @property
    def destination(self) -> Vector | None:
        """Below, as high as the start."""
        state = self.context.bus.state.latest
        if state is None:
            return None
        return np.array((*state.position[:2], self.context.track.start.position[2]))

    @property
    def leads_to(self) -> Phase:
        """The ground."""
        return Phase.LANDED

    async def run(self) -> Result:
        """Ask the autopilot to land and wait until it has disarmed."""
        autopilot, machine, state = self.context.autopilot, self.context.machine, self.context.bus.state.latest
        self._from = float(state.position[2]) if state is not None else math.nan
        if machine.phase in (Phase.ARMED, Phase.TAKEOFF):
            machine.go(Phase.ABORTED, self.context.now(), "landing during takeoff")
        if machine.phase is not Phase.ABORTED:
            machine.go(Phase.LANDING, self.context.now(), "landing asked for")
        self.context.line.clear()
        status = Reader(autopilot.status)
        await autopilot.land()
        landing = False
        while (latest := await status.newest()).armed:
            landing |= latest.mode in LANDING
            # On the ground PX4 may return to the mode before the landing just before it tells of the disarming.
            if landing and latest.mode not in LANDING and not latest.landed:
                return Result(Outcome.WRONG_PROGRESS, f"the autopilot left the landing for its mode {latest.mode}")
        if machine.phase is not Phase.ABORTED:
            machine.go(Phase.LANDED, self.context.now(), "disarmed on the ground")
        return Result(Outcome.GOAL_ACHIEVED, "landed and disarmed")

    def stopped(self) -> None:
        """Nothing: the autopilot goes on landing."""
