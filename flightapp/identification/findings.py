"""What flight logs tell of a vehicle, parameter by parameter, and what they don't and why."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightapp.config import Vehicle
from flightapp.frames import GRAVITY, Vector, quat_to_matrix
from flightapp.identification import force
from flightapp.identification.force import ForceFit, fit_force
from flightapp.identification.rates import RateFit, fit_rates
from flightapp.identification.series import Stretch

RATE_PEAK, YAW_RATE_PEAK = 1.0, 0.5
"""rad/s that commanded rates must reach to tell delay and lag."""
SPEED_PEAK, CLIMB_PEAK = 1.0, 0.5
"""m/s, body axes, that must be reached to tell the drag."""
THRUST_SWING = 0.05
"""Of the hover thrust, standard deviation of the throttle that tells motor lag and curve."""
VOLTAGE_SWING = 0.01
"""Of the voltage, range that tells what the battery does to the thrust."""
WORST = {"delay": 0.005, "rate_lag": 0.010, "yaw_rate_lag": 0.03, "motor_lag": 0.010, "drag": 0.15}
"""Standard errors (s; 1/s) beyond which a parameter counts as not told."""
WORST_HOVER = 0.02
"""Likewise, of the hover thrust: relative."""
WORST_CURVE = 0.1
TRACKER_SCALE = 0.03
"""Share by which a tracker's velocities may be wrong throughout, and the drag with them: a T265's are about so much
short (table 9 of "Framework and Evaluation Methodology for Autonomous Drone Racing"; librealsense issue 3970)."""
LACKING = 0.25
"""Of the throttle's relative variance, the share of the thrust that a quickly changed throttle may lack: thrust is the
square of the rotors' speed, it is the speed that lags, and its relative variance is a quarter of the throttle's."""
GUESSED = (0.01, 0.03)
"""s, delay and lag of the thrust with which the search begins."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One parameter of the vehicle section."""

    key: str
    before: float
    value: float
    sigma: float
    """Standard error, with what the model lacks; NaN for what was not measured but follows from what was."""
    unit: str
    quality: float = math.nan
    """Share of the variance that the model explains, of what the parameter was found from."""
    note: str = ""
    axis: int | None = None
    """Of a parameter with three axes."""

    @property
    def name(self) -> str:
        """As in a table."""
        return self.key if self.axis is None else f"{self.key} {'xyz'[self.axis]}"


@dataclass(frozen=True, slots=True)
class Refusal:
    """A parameter that the flights did not tell, and why."""

    name: str
    why: str


@dataclass(frozen=True, slots=True)
class Identified:
    """All that was found."""

    before: Vehicle
    """What the vehicle was taken for."""
    findings: tuple[Finding, ...]
    refusals: tuple[Refusal, ...]
    duration: float
    """s that were used."""

    def value(self, name: str) -> float | None:
        """What was found of ``name``, as in the table; None for nothing."""
        return next((f.value for f in self.findings if f.name == name), None)


class _Notes:
    """Findings and refusals as they come."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self.refusals: list[Refusal] = []

    def refuse(self, why: str, *names: str) -> None:
        self.refusals += [Refusal(name, why) for name in names]

    def take(self, found: Finding, worst: float) -> None:
        """Keep what is known well enough."""
        if found.sigma <= worst:
            self.findings.append(found)
        else:
            self.refuse(f"known only to ± {found.sigma:.2g} {found.unit}, more than {worst:.2g}", found.name)


def identify(parts: Sequence[Stretch], before: Vehicle, map_known: bool = True) -> Identified:
    """Everything that ``parts`` (at least one) tell of the vehicle that was taken for ``before``.

    ``map_known``: whether it is known which throttle was made of each thrust; else nothing is said of the thrust.
    """
    notes = _Notes()
    _tell_rates(parts, before, notes)
    _tell_force(parts, before, map_known, notes)
    return Identified(before, tuple(notes.findings), tuple(notes.refusals), sum(part.duration for part in parts))


def _tell_rates(parts: Sequence[Stretch], before: Vehicle, notes: _Notes) -> None:
    peak = _peak([part.rates[:, :2] for part in parts])
    if peak < RATE_PEAK:
        notes.refuse(
            f"roll and pitch rates were never commanded above {peak:.2f} rad/s; it takes {RATE_PEAK:g} rad/s",
            *("delay", "rate_lag"),
        )
    else:
        tilt = fit_rates(parts, (0, 1))
        notes.take(Finding("delay", before.delay, tilt.delay, tilt.delay_sigma, "s", tilt.explained), WORST["delay"])
        found = Finding("rate_lag", before.rate_lag, tilt.lag, tilt.lag_sigma, "s", tilt.explained)
        notes.take(found, WORST["rate_lag"])
    peak = _peak([part.rates[:, 2:] for part in parts])
    if peak < YAW_RATE_PEAK:
        why = f"yaw rates were never commanded above {peak:.2f} rad/s; it takes {YAW_RATE_PEAK:g} rad/s"
        notes.refuse(why, "yaw_rate_lag")
        return
    yaw: RateFit = fit_rates(parts, (2,), _value(notes, "delay", before.delay))
    found = Finding("yaw_rate_lag", before.yaw_rate_lag, yaw.lag, yaw.lag_sigma, "s", yaw.explained)
    notes.take(found, WORST["yaw_rate_lag"])


def _tell_force(parts: Sequence[Stretch], before: Vehicle, map_known: bool, notes: _Notes) -> None:
    if not map_known:
        why = (
            "the map from thrust to throttle was being corrected in flight; fly with vehicle.learn_hover_thrust=false,"
            " as missions/identify.py does"
        )
        notes.refuse(why, "hover_thrust", "thrust_curve", "motor_lag", "drag x", "drag y", "drag z")
        return
    throttle = np.concatenate([part.throttle for part in parts])
    swing = float(np.std(throttle)) / before.hover_thrust
    shaken = swing >= THRUST_SWING
    voltage, swinging = _voltage(parts)
    peaks = _body_peaks(parts)
    fast = [bool(peaks[k] >= (CLIMB_PEAK if k == 2 else SPEED_PEAK)) for k in range(3)]
    free = [force.A, *([force.B, force.DELAY, force.LAG] if shaken else []), *([force.EXPONENT] if swinging else [])]
    free += [force.DRAG + k for k in range(3) if fast[k]]
    fit = fit_force(parts, _given(before, swinging), free, voltage if swinging else math.nan)
    _tell_thrust(fit, before, voltage, swing, notes)
    if shaken:
        _tell_motors(fit, before, notes)
    else:
        why = (
            f"the throttle swung by only {100.0 * swing:.0f} % of the hover thrust; it takes {100 * THRUST_SWING:.0f} %"
        )
        notes.refuse(why, "thrust_curve", "motor_lag")
    for k in range(3):
        if not fast[k]:
            least = CLIMB_PEAK if k == 2 else SPEED_PEAK
            why = f"the speed along body {'xyz'[k]} was never above {peaks[k]:.2f} m/s; it takes {least:g} m/s"
            notes.refuse(why, f"drag {'xyz'[k]}")
            continue
        place = force.DRAG + k
        value = float(fit.values[place])
        sigma = math.hypot(math.sqrt(fit.covariance[place, place]), TRACKER_SCALE * value)
        note = "" if value >= 0.0 else f"{value:.3f} was found, which no vehicle has"
        found = Finding("drag", before.drag[k], max(value, 0.0), sigma, "1/s", float(fit.explained[k]), note, k)
        notes.take(found, WORST["drag"])


def _tell_thrust(fit: ForceFit, before: Vehicle, voltage: float, swing: float, notes: _Notes) -> None:
    """Hover thrust, and what follows from it; ``swing`` is the throttle's relative standard deviation."""
    a, b = fit.values[force.A], fit.values[force.B]
    hover = _hover(a, b)
    slope = np.array((hover, hover**2)) / (a + 2.0 * b * hover)
    sigma = math.sqrt(slope @ fit.covariance[: force.B + 1, : force.B + 1] @ slope)
    sigma = math.hypot(sigma, LACKING * swing**2 * hover)
    quality = float(fit.explained[2])
    notes.take(Finding("hover_thrust", before.hover_thrust, hover, sigma, "", quality), WORST_HOVER * hover)
    if _value(notes, "hover_thrust", math.nan) != hover:
        return
    if math.isfinite(voltage):
        note = "mean voltage of the flights, where hover_thrust holds"
        notes.findings.append(Finding("hover_voltage", before.hover_voltage, voltage, math.nan, "V", note=note))
    scaled = before.thrust_to_weight * before.hover_thrust / hover
    note = "scaled with hover_thrust: full throttle was not flown"
    notes.findings.append(
        Finding("thrust_to_weight", before.thrust_to_weight, max(scaled, 1.11), math.nan, "", note=note)
    )


def _tell_motors(fit: ForceFit, before: Vehicle, notes: _Notes) -> None:
    """The motors' curve, and their lag beyond the delay of the rates."""
    a, b = fit.values[force.A], fit.values[force.B]
    slope = np.array((-b, a)) / (a + b) ** 2
    sigma = math.sqrt(slope @ fit.covariance[: force.B + 1, : force.B + 1] @ slope)
    curve, quality, note = float(b / (a + b)), float(fit.explained[2]), ""
    if curve < 0.0:
        note = f"{curve:.2f} was found: thrust falls short at high throttle, as of a battery that sags"
    curve = min(max(curve, 0.0), 1.0)
    notes.take(Finding("thrust_curve", before.thrust_curve, curve, sigma, "", quality, note), WORST_CURVE)
    place = [force.DELAY, force.LAG]
    sigma = math.sqrt(float(np.sum(fit.covariance[np.ix_(place, place)])))
    late = float(fit.values[force.DELAY] + fit.values[force.LAG])
    lag = late - _value(notes, "delay", before.delay)
    note = "beyond the delay" if lag >= 0.0 else f"the thrust follows {1e3 * late:.0f} ms behind its command, sooner"
    notes.take(Finding("motor_lag", before.motor_lag, max(lag, 0.0), sigma, "s", quality, note), WORST["motor_lag"])


def _given(before: Vehicle, swinging: bool) -> Vector:
    """(8,) what is believed beforehand: it stays where it is not told."""
    full = GRAVITY / (before.hover_thrust * (before.thrust_curve * before.hover_thrust + 1.0 - before.thrust_curve))
    linear, square = full * (1.0 - before.thrust_curve), full * before.thrust_curve
    return np.array((linear, square, *GUESSED, 2.0 if swinging else 0.0, *before.drag))


def _hover(a: float, b: float) -> float:
    """The throttle u with a u + b u² = g."""
    return float(2.0 * GRAVITY / (a + math.sqrt(max(a * a + 4.0 * b * GRAVITY, 0.0))))


def _value(notes: _Notes, key: str, otherwise: float) -> float:
    return next((found.value for found in notes.findings if found.key == key), otherwise)


def _peak(arrays: Sequence[Vector]) -> float:
    """Greatest length but for the outermost per mille, which noise makes."""
    return float(np.quantile(np.concatenate([np.linalg.norm(a, axis=1) for a in arrays]), 0.999))


def _body_peaks(parts: Sequence[Stretch]) -> Vector:
    """(3,) m/s, greatest speed along each body axis, likewise."""
    rows = [quat_to_matrix(q).T @ v for part in parts for q, v in zip(part.orientation, part.velocity, strict=True)]
    peaks: Vector = np.quantile(np.abs(np.array(rows)), 0.999, axis=0)
    return peaks


def _voltage(parts: Sequence[Stretch]) -> tuple[float, bool]:
    """Mean voltage (V, NaN where it was not told throughout) and whether it changed enough to tell its effect."""
    volts = np.concatenate([part.voltage for part in parts])
    mean = float(np.mean(volts))
    return mean, bool(math.isfinite(mean) and np.ptp(volts) > VOLTAGE_SWING * mean)
