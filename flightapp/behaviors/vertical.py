"""Leaving the ground and coming back to it, by the autopilot's own means."""

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.channel import Reader
from flightapp.messages import FlightMode, Outcome, Phase
from flightapp.trajectory import hover


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
        """Takeoff → hold → offboard."""
        autopilot, machine = self.context.autopilot, self.context.machine
        status = Reader(autopilot.status)
        while (latest := autopilot.status.latest) is None or not latest.ready:
            await status.newest()
        if self.context.bus.state.latest is None:
            await self.context.bus.state.next()
        self.context.release_guard()
        await autopilot.arm()
        machine.go(Phase.ARMED, self.context.now(), "takeoff asked for")
        await autopilot.takeoff(self._height)
        machine.go(Phase.TAKEOFF, self.context.now(), f"to {self._height:g} m")
        while (latest := autopilot.status.latest) is None or latest.mode is not FlightMode.TAKEOFF:
            await status.newest()
        while (latest := await status.newest()).mode is FlightMode.TAKEOFF:
            pass
        if not latest.armed or latest.mode is not FlightMode.HOLD:
            return Result(Outcome.WRONG_PROGRESS, "the autopilot left the climb before its end")
        await self._take_command()
        machine.go(Phase.FLYING, self.context.now(), "height reached")
        return Result(Outcome.GOAL_ACHIEVED, f"hovering at {self._height:g} m")

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
