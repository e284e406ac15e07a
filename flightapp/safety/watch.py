"""Gathers the monitor's readings from the topics."""

import math
from collections.abc import Callable
from pathlib import Path

from flightapp.bus import Bus
from flightapp.interfaces import Autopilot, Computer
from flightapp.messages import PlanReport, VehicleState
from flightapp.planning.line import Line
from flightapp.safety.faults import Stage
from flightapp.safety.monitor import Readings
from flightapp.timing import Ticker

FRESH = 0.1
"""s, a setpoint older than this is not being flown."""
SLOW_LOOK = 0.5
"""s between looks at the disk."""
SECOND = 1.0
"""s over which missed ticks are counted."""


class Watch:
    """Looks at everything that the `Monitor` judges: ``ticker`` is the sender's, of ``rate`` Hz.

    ``directory`` is where the log is written, and ``log_error`` tells why that fails, if it does.
    """

    def __init__(
        self,
        bus: Bus,
        autopilot: Autopilot,
        line: Line,
        computer: Computer,
        ticker: Ticker,
        rate: float,
        directory: Path,
        log_error: Callable[[], str],
        begun: float,
    ) -> None:
        self._bus, self._autopilot, self._line = bus, autopilot, line
        self._computer, self._directory, self._log_error = computer, directory, log_error
        self._ticker, self._rate = ticker, rate
        self._begun = begun
        self._refused = 0
        self._counted, self._overruns, self._missed = begun, ticker.overruns, 0.0
        self._disk_looked, self._free = -math.inf, math.inf
        self._offset = math.nan
        bus.plan.tap(self._planned)

    def _planned(self, report: PlanReport) -> None:
        self._refused = 0 if report.accepted else self._refused + 1

    def readings(self, stamp: float) -> Readings:
        """Everything at ``stamp``, which is now."""
        bus, state, status = self._bus, self._bus.state.latest, self._autopilot.status.latest
        phase, pose, image = bus.phase.latest, bus.pose.latest, bus.frame.latest
        commanded = self._line.latest is not None
        return Readings(
            stamp,
            Stage.PREFLIGHT if phase is None else Stage.of(phase),
            commanded=commanded,
            state_age=math.nan if state is None else stamp - state.stamp,
            doubt="" if state is None else state.doubt,
            pose_age=math.nan if pose is None else stamp - pose.stamp,
            position=None if state is None else state.position,
            speed=0.0 if state is None else math.hypot(*state.velocity.tolist()),
            tilt=0.0 if state is None else _tilt(state),
            line_error=self._line_error(stamp, state) if commanded else 0.0,
            image_age=stamp - (self._begun if image is None else image.stamp),
            images=bus.frame.count,
            detection_lag=self._lag(),
            ticks_missed=self._ticks_missed(stamp),
            plans_refused=self._refused,
            at_rest=commanded and self._line.at_rest(stamp),
            armed=status is not None and status.armed,
            mode=None if status is None else status.mode,
            status_age=math.nan if status is None else stamp - status.stamp,
            charge=math.nan if status is None else status.battery,
            disk_free=self._disk_free(stamp),
            clock_moved=self._clock_moved(),
            log_error=self._log_error(),
        )

    def _line_error(self, stamp: float, state: VehicleState | None) -> float:
        setpoint = self._bus.setpoint.latest
        if state is None or setpoint is None or stamp - setpoint.stamp >= FRESH:
            return 0.0
        return float(abs(setpoint.position - state.position).max())

    def _lag(self) -> float:
        image, seen = self._bus.frame.latest, self._bus.sightings.latest
        return 0.0 if image is None or seen is None else image.stamp - seen.stamp

    def _ticks_missed(self, stamp: float) -> float:
        elapsed = stamp - self._counted
        if elapsed >= SECOND:
            missed = self._ticker.overruns - self._overruns
            self._missed = min(missed / (elapsed * self._rate), 1.0)
            self._counted, self._overruns = stamp, self._ticker.overruns
        return self._missed

    def _disk_free(self, stamp: float) -> float:
        if stamp - self._disk_looked >= SLOW_LOOK:
            self._disk_looked, self._free = stamp, self._computer.disk_free(self._directory)
        return self._free

    def _clock_moved(self) -> float:
        offset, before = self._computer.clock_offset(), self._offset
        self._offset = offset
        return 0.0 if math.isnan(before) else offset - before


def _tilt(state: VehicleState) -> float:
    """rad between the body's z axis and up."""
    w, x, y, z = state.orientation.tolist()
    return math.acos(min(max(1.0 - 2.0 * (x * x + y * y) / (w * w + x * x + y * y + z * z), -1.0), 1.0))
