"""PX4 as a whole, as whoever talks to it meets it: commands in, state and estimate out, faults to inject."""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector
from sim.plant import Plant
from sim.px4.commander import CRITICAL, INFO, Text, refused
from sim.px4.estimator import Estimate
from sim.px4.failsafe import Action
from sim.px4.loop import Loop
from sim.px4.modes import Landed, NavState, Need, Reply
from sim.px4.parameters import Parameters

BOOT = 3.0
"""s from a reboot until the vehicle answers again."""
EMPTY_CELL = 3.4
"""V, of a battery that has failed."""


class Px4:
    """One vehicle's autopilot; owns the ``plant``.

    ``time`` gives the present in the plant's time, and nothing happens but in `advance` and in the calls. ``seed``
    gives the errors of the estimate. Without ``parameters`` they are those of an indoor vehicle with MPC_THR_HOVER as
    ``config`` has it; the thrust curve is always the configuration's: the flight side's belief, not the plant's truth.
    """

    def __init__(
        self,
        config: Config,
        plant: Plant,
        seed: int,
        time: Callable[[], float],
        parameters: Parameters | None = None,
    ) -> None:
        self.plant = plant
        self.parameters = parameters or Parameters({"MPC_THR_HOVER": config.vehicle.hover_thrust})
        self._time = time
        self._loop = Loop(plant, seed, self.parameters, config.vehicle.thrust_curve)
        self._crashed = False
        self.boot_time = plant.time
        """When it was last switched on."""

    def advance(self, until: float) -> None:
        """Let the vehicle fly on to ``until``; the plant's trace then holds all of it."""
        self._loop.advance(until)

    # State, as PX4 reports it.

    @property
    def texts(self) -> deque[Text]:
        """What PX4 sends as STATUSTEXT, oldest first; whoever reads takes them out."""
        return self._loop.commander.texts

    @property
    def changes(self) -> int:
        """Counts changes of mode, arming and landing."""
        return self._loop.changes

    @property
    def nav_state(self) -> NavState:
        """The mode that is flown."""
        return self._loop.commander.nav_state

    @property
    def intention(self) -> NavState:
        """The mode that the user chose."""
        return self._loop.commander.intention

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""
        return self._loop.commander.armed

    @property
    def on_ground(self) -> bool:
        """What the land detector says; disarmed, it always says so."""
        return self._loop.on_ground

    @property
    def landed(self) -> Landed:
        """As in EXTENDED_SYS_STATE."""
        if self.on_ground:
            return Landed.ON_GROUND
        if self.nav_state is NavState.AUTO_TAKEOFF:
            return Landed.TAKEOFF
        return Landed.LANDING if self.nav_state is NavState.AUTO_LAND else Landed.IN_AIR

    @property
    def failsafe(self) -> bool:
        """vehicle_status.failsafe: an action is active, be it only a warning."""
        return self._loop.commander.failsafe.action is not Action.NONE

    @property
    def ready(self) -> bool:
        """Whether there is a local position."""
        return Need.LOCAL_POSITION in self._loop.commander.have

    @property
    def armable(self) -> bool:
        """Whether the arming checks of the present mode pass (MAV_SYS_STATUS_PREARM_CHECK)."""
        return self.armed or not self._loop.commander.arming_failures()

    @property
    def booting(self) -> bool:
        """Whether it is silent after a reboot."""
        return self._time() < self._loop.up_since

    @property
    def battery(self) -> float:
        """0..1, what the battery seems to have left."""
        return self._loop.battery

    @property
    def voltage(self) -> float:
        """V, under load."""
        voltage = self.plant.voltage
        return min(voltage, EMPTY_CELL * self.plant.vehicle.battery.cells) if self._loop.battery_failed else voltage

    def estimate(self) -> Estimate:
        """What EKF2 believes now."""
        return self._loop.ekf.estimate(self._now)

    @property
    def _now(self) -> float:
        return max(self._time(), self.plant.time)

    # Commands. A refusal's text says why, also where PX4 itself sends no text; what it does send stands in `texts`.

    def arm(self) -> Reply:
        """Arm in the intended mode. A command from outside that forces it passes the same checks."""
        if self.booting:
            return refused("booting")
        now, was = self._time(), self.armed
        self._loop.check(now)
        reply = self._loop.commander.arm(now)
        if self.armed and not was:
            self._loop.armed(now)
        return reply

    def disarm(self, force: bool = False) -> Reply:
        """Disarm on the ground, or with ``force`` anywhere."""
        now, detector = self._time(), self._loop.flight.detector
        landed = detector.landed or detector.maybe_landed
        reply = self._loop.commander.disarm(now, "external command", landed, force)
        self._loop.settle(now)
        return reply

    def kill(self) -> Reply:
        """Stop the motors at once, anywhere: a forced disarming."""
        return self.disarm(force=True)

    def set_mode(self, mode: NavState) -> Reply:
        """Choose ``mode``, as DO_SET_MODE does, whose refusal comes without a text."""
        if self.booting:
            return refused("booting")
        now = self._time()
        reply = self._loop.commander.request(mode, now)
        self._loop.settle(now)
        return reply

    def takeoff(self) -> Reply:
        """NAV_TAKEOFF: to MIS_TAKEOFF_ALT above where it is then; begins when armed."""
        return self._command(NavState.AUTO_TAKEOFF)

    def land(self) -> Reply:
        """NAV_LAND."""
        reply = self._command(NavState.AUTO_LAND)
        if reply.accepted:
            self._loop.commander.tell(INFO, "Landing at current position")
        return reply

    def _command(self, mode: NavState) -> Reply:
        reply = self.set_mode(mode)
        if not reply.accepted:
            self._loop.commander.tell(CRITICAL, f"Switching to {mode.label} is currently not available")
        return reply

    def attitude_target(self, rates_flu: Sequence[float] | Vector, throttle: float) -> None:
        """One setpoint of body rates (3,) rad/s and collective thrust 0..1; followed while armed in OFFBOARD."""
        p, q, r = rates_flu
        self._loop.rates(self._time(), (float(p), float(q), float(r)), throttle)

    def attitude_setpoint(self, orientation_wb: Vector, throttle: float) -> None:
        """One setpoint of attitude (4,), in the estimate's frame, and collective thrust 0..1."""
        self._loop.attitude(self._time(), np.array(orientation_wb, dtype=float), throttle)

    def external_vision(
        self,
        stamp: float,
        position: Vector,
        orientation: Vector,
        velocity: Vector | None = None,
        reset_counter: int = 0,
    ) -> None:
        """One pose of the body (FLU) in the tracker's frame (z up), with the velocity (3,) m/s along its axes.

        ``stamp`` is what PX4 takes the pose's time to be, in the plant's time: the moment of receipt, unless the
        clocks are synchronised. Poses that are not finite or too old are dropped.
        """
        if not self.booting:
            self._loop.ekf.vision(self._now, stamp, position, orientation, velocity, reset_counter)

    def set_global_origin(self) -> None:
        """SET_GPS_GLOBAL_ORIGIN: with a local position there is then a global one."""
        self._loop.commander.origin = True

    # Faults.

    def pilot(self, mode: NavState) -> Reply:
        """A pilot with a transmitter switches to ``mode``; from now on there is manual control, sticks centred."""
        self._loop.manual = True
        self.push_sticks(0.0, 0.0)
        self._loop.check(self._time())
        return self.set_mode(mode)

    def push_sticks(self, vx: float, vy: float) -> None:
        """The pilot asks for a velocity, m/s in the estimate's frame, which a mode that follows positions flies."""
        self._loop.flight.sticks = (vx, vy)

    def lose_pilot(self) -> None:
        """The transmitter is gone."""
        self._loop.manual = False

    def fail_battery(self) -> None:
        """The battery is critically low from now on."""
        self._loop.battery_failed = True

    def refuse_arming(self, reason: str | None) -> None:
        """Fail a preflight check for ``reason``; None passes it again."""
        self._loop.commander.broken = reason or ("motor failure" if self._crashed else "")

    def reboot(self) -> None:
        """Restart at once, wherever it is: motors off, silent for `BOOT`; parameters stay."""
        self.boot_time = self._time()
        self.plant.stop_motors()
        self._loop.begin(self.boot_time + BOOT)

    def crash(self) -> None:
        """Cut the motors for good."""
        self._crashed = True
        self.refuse_arming(None)
        self.kill()
