"""Leaving the ground and coming back to it, by the autopilot's own means."""

import asyncio
import contextlib
import math

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.channel import Reader
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
ARM_PATIENCE = 8.0
"""s during which arming is tried again."""


class Takeoff(Behavior):
    """Arm, climb and hand the motion over to the application.

    Ends with the application in command (offboard), hovering where the climb ended.
    """

    name = "takeoff"
    phases = frozenset({Phase.IDLE, Phase.LANDED})
    needs_state = False

    def __init__(self, context: Context, height: float) -> None:
        super().__init__(context, context.config.mission.takeoff_timeout)
        self._height = height

    async def run(self) -> Result:
        """Ready → takeoff mode → armed → at the height → offboard."""
        autopilot, machine = self.context.autopilot, self.context.machine
        status = Reader(autopilot.status)
        while (latest := autopilot.status.latest) is None or not latest.ready:
            await status.newest()
        ground = self.context.bus.state.latest or await self.context.bus.state.next()
        self.context.release_guard()
        await autopilot.takeoff(self._height)
        await self._arm()
        machine.go(Phase.ARMED, self.context.now(), "takeoff asked for")
        machine.go(Phase.TAKEOFF, self.context.now(), f"to {self._height:g} m")
        left = await self._climb(status, float(ground.position[2]))
        if left is not None:
            return Result(Outcome.WRONG_PROGRESS, f"the autopilot left the climb before its end: {left}")
        await self._take_command()
        machine.go(Phase.FLYING, self.context.now(), "the climb is over")
        here = self.context.bus.state.latest or ground
        return Result(Outcome.GOAL_ACHIEVED, f"hovering {here.position[2] - ground.position[2]:.1f} m above the ground")

    async def _arm(self) -> None:
        """Arm; the autopilot's checks may take a moment to notice that the position has become good."""
        give_up = self.context.now() + ARM_PATIENCE
        while True:
            try:
                return await self._arm_once()
            except AutopilotError:
                if self.context.now() > give_up:
                    raise
            await asyncio.sleep(0.5)

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


class Land(Behavior):
    """Land here and disarm."""

    name = "land"
    phases = frozenset({Phase.FLYING, Phase.TAKEOFF, Phase.LANDING, Phase.ABORTED})
    needs_state = False

    def __init__(self, context: Context) -> None:
        super().__init__(context, context.config.mission.land_timeout)

    async def run(self) -> Result:
        """Ask the autopilot to land and wait until it has disarmed."""
        autopilot, machine = self.context.autopilot, self.context.machine
        status = Reader(autopilot.status)
        if machine.phase is Phase.TAKEOFF:
            machine.go(Phase.ABORTED, self.context.now(), "landing during takeoff")
        if machine.phase is not Phase.ABORTED:
            machine.go(Phase.LANDING, self.context.now(), "landing asked for")
        self.context.line.clear()
        await autopilot.land()
        while (await status.newest()).armed:
            pass
        if machine.phase is not Phase.ABORTED:
            machine.go(Phase.LANDED, self.context.now(), "disarmed on the ground")
        return Result(Outcome.GOAL_ACHIEVED, "landed and disarmed")
