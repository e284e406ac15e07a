"""What PX4 does by itself as time goes on: checks, failsafes, controllers, land detection, disarming.

The commander's checks run at 10 Hz as in PX4, the position controller at 100 Hz while it flies the vehicle.
"""

import math

from flightapp.frames import Vector
from sim.plant import Plant
from sim.px4.commander import INFO, Commander
from sim.px4.estimator import Ekf2, Estimate
from sim.px4.failsafe import Battery
from sim.px4.flight import TICK, Command, Flight, attitude_rates
from sim.px4.modes import NavState, Need
from sim.px4.parameters import Parameters

CHECK = 0.1
"""s, period of the commander's checks (Commander.cpp)."""
_MOMENT = 1e-9


class Loop:
    """The running autopilot on its ``plant``; clock-free: every call says when it is, in the plant's time.

    ``seed`` gives the errors of the estimate, ``curve`` what is left of the motors' curve (see `ThrustMap`).
    """

    def __init__(self, plant: Plant, seed: int, parameters: Parameters, curve: float) -> None:
        self.plant = plant
        self.parameters = parameters
        self.commander = Commander(parameters)
        self.ekf = Ekf2(plant, parameters, seed)
        self.flight = Flight(parameters, curve)
        self.manual = False
        """Whether a pilot has sticks."""
        self.battery_failed = False
        self.changes = 0
        """Counts changes of mode, arming and landing."""
        self._delay = plant.vehicle.delay
        self.begin(plant.time)

    def begin(self, now: float) -> None:
        """Boot; until ``now``, when that is over, nothing is checked."""
        self.up_since = now
        self.commander.boot(now)
        self.ekf.restart()
        self.flight.disarmed()
        self._state = (self.commander.nav_state, False, True)
        self.changes += 1
        self._next_check = now + CHECK
        self._tick = now
        self._flown = False
        self._setpoint: Command | None = None
        self._attitude: Vector | None = None
        self._setpoint_at = -math.inf

    @property
    def on_ground(self) -> bool:
        """What the land detector says; disarmed, it always says so."""
        return not self.commander.armed or self.flight.detector.landed

    @property
    def battery(self) -> float:
        """0..1, what the battery seems to have left."""
        if not self.battery_failed:
            return self.plant.charge
        p = self.parameters
        return 0.5 * (float(p["BAT_CRIT_THR"]) + float(p["BAT_EMERGEN_THR"]))

    # What comes from outside.

    def armed(self, now: float) -> None:
        """It was armed just now."""
        self._flown = False
        self._enter(now)
        self._note()

    def rates(self, now: float, rates_flu: tuple[float, float, float], throttle: float) -> None:
        """A setpoint of body rates, rad/s, and collective thrust 0..1."""
        self._attitude = None
        self._hear(now, (rates_flu, throttle))

    def attitude(self, now: float, orientation: Vector, throttle: float) -> None:
        """A setpoint of attitude (4,), in the estimate's frame, and collective thrust 0..1."""
        if self._attitude is None:
            self._tick = now
        self._attitude = orientation
        self._hear(now, (attitude_rates(orientation, self.ekf.estimate(now)), throttle))

    def _hear(self, now: float, setpoint: Command) -> None:
        self._setpoint, self._setpoint_at = setpoint, now
        if now >= self.up_since and Need.OFFBOARD_SIGNAL not in self.commander.have:
            self.commander.hear_offboard(now)
            self.settle(now)
        if self.commander.armed and self.commander.nav_state is NavState.OFFBOARD:
            self._follow(now)

    def _follow(self, now: float) -> None:
        if self._setpoint is not None:
            self.plant.command(now + self._delay, *self._setpoint)

    # What it does by itself.

    def advance(self, until: float) -> None:
        """Let the vehicle fly on to ``until``; the plant's trace then holds all of it."""
        event = self._next_event()
        self.plant.advance(event if event < until else until)
        while event <= until:
            self._act(event)
            event = self._next_event()
            self.plant.advance(event if event < until else until, extend=True)

    def _closed(self) -> bool:
        """Whether a controller of PX4's own, above the rate loop, is at work."""
        followed = self.commander.nav_state is NavState.OFFBOARD and self._attitude is None
        return self.commander.armed and not followed

    def _next_event(self) -> float:
        return min(self._tick, self._next_check) if self._closed() else self._next_check

    def _act(self, now: float) -> None:
        """Do what is due at ``now``."""
        if now >= self._next_check - _MOMENT:
            self._next_check += CHECK
            self.check(now)
            if self.commander.armed and not self._closed():
                self._watch_ground(now, self.ekf.estimate(now))
        if self._closed() and now >= self._tick - _MOMENT:
            self._tick = now + TICK
            self._fly(now)

    def check(self, now: float) -> None:
        """The commander's checks, and what follows from them."""
        if now < self.up_since:
            return
        ekf = self.ekf
        ekf.update(now)
        fresh = now < self._setpoint_at + float(self.parameters["COM_OF_LOSS_T"])
        self.commander.check(now, ekf.position_valid, ekf.altitude_valid, fresh, self.manual, self._warning())
        self.settle(now)

    def _warning(self) -> Battery:
        left, p = self.battery, self.parameters
        if left < float(p["BAT_EMERGEN_THR"]):
            return Battery.EMERGENCY
        if left < float(p["BAT_CRIT_THR"]):
            return Battery.CRITICAL
        return Battery.LOW if left < float(p["BAT_LOW_THR"]) else Battery.NONE

    def settle(self, now: float) -> None:
        """Act on a mode or an arming state that has changed."""
        mode, armed, _ = self._state
        if armed and not self.commander.armed:
            self.plant.stop_motors()
            self.flight.disarmed()
        elif armed and mode is not self.commander.nav_state:
            self._enter(now)
        self._note()

    def _note(self) -> None:
        state = (self.commander.nav_state, self.commander.armed, self.on_ground)
        if state != self._state:
            self._state = state
            self.changes += 1

    def _enter(self, now: float) -> None:
        """Begin the present mode."""
        self.plant.drop_pending()
        self._tick = now
        mode = self.commander.nav_state
        self.flight.shift(*self.ekf.take_move())
        self.flight.enter(mode, self.ekf.estimate(now), self.commander.origin)
        if mode is NavState.AUTO_TAKEOFF:
            height = float(self.parameters["MIS_TAKEOFF_ALT"])
            self.commander.tell(INFO, f"Using default takeoff altitude: {height:.1f} m")
        if mode is NavState.OFFBOARD:
            self._follow(now)

    def _fly(self, now: float) -> None:
        """One run of PX4's own controllers."""
        commander, estimate = self.commander, self.ekf.estimate(now)
        self.flight.shift(*self.ekf.take_move())
        self._watch_ground(now, estimate)
        if not commander.armed:
            return
        if commander.nav_state is NavState.OFFBOARD:
            if self._attitude is not None and self._setpoint is not None:
                self.plant.command(now, attitude_rates(self._attitude, estimate), self._setpoint[1])
            return
        spooling = now - commander.armed_at < float(self.parameters["COM_SPOOLUP_TIME"])
        self.plant.command(now, *self.flight.command(commander.nav_state, estimate, spooling))
        # A completed takeoff holds where it can; where it can't, it goes on as it is (checkForMissionUpdate).
        climbed = commander.nav_state is NavState.AUTO_TAKEOFF and self.flight.climbed(estimate)
        if climbed and commander.can_run(NavState.AUTO_LOITER):
            commander.request(NavState.AUTO_LOITER, now)
            self.settle(now)

    def _watch_ground(self, now: float, estimate: Estimate) -> None:
        detector, was = self.flight.detector, self.flight.detector.landed
        mode, throttle = self.commander.nav_state, self.flight.throttle
        if mode is NavState.OFFBOARD:
            throttle = self._setpoint[1] if self._setpoint else 0.0
        self.flight.watch_ground(now, mode, estimate, throttle)
        if was != detector.landed:
            self.commander.tell(INFO, "Landing detected" if detector.landed else "Takeoff detected")
        self._flown |= not detector.landed
        self._disarm_when_due(now, detector.landed_for(now))
        self._note()

    def _disarm_when_due(self, now: float, landed_for: float) -> None:
        """COM_DISARM_LAND after a flight, COM_DISARM_PRFLT without one; neither where it is not positive."""
        waited = landed_for if self._flown else now - self.commander.armed_at
        patience = float(self.parameters["COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"])
        if patience > 0.0 and waited >= patience:
            reason = "landing" if self._flown else "auto preflight disarming"
            self.commander.disarm(now, reason, landed=True, force=False)
            self.settle(now)
