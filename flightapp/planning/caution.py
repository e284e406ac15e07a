"""How fast is wise: a share of the planned speed, from what is known of the gate ahead, the battery and the wind."""

import math
from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import GRAVITY
from flightapp.messages import GateEstimate
from flightapp.planning.course import horizontal_sigma
from flightapp.planning.pacer import Paced
from flightapp.track import GateShape

BAND = 0.06
"""Change of the wanted rate that is worth a change of pace."""
PATIENCE = 0.6
"""s for which a higher rate must have been wanted before the pace goes up: no chatter, and down at once."""
CALM = 0.5
"""m/s², less than that is drag that the controller doesn't know, and costs no pace."""
INTERVAL = 0.05
"""s between the moments of a plan at which its specific force is looked at."""


class Caution:
    """Decides the wanted pace, with hysteresis."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._faster_since = math.inf
        self.held = ""
        """Why the pace is kept at its least, whatever else there is; empty where it isn't."""

    def wanted(
        self,
        stamp: float,
        flying: Paced,
        gates: Sequence[GateEstimate],
        shape: GateShape,
        voltage: float,
        push: float,
    ) -> tuple[float, str]:
        """The rate for the plan being flown after ``stamp``, and why.

        ``voltage`` (V) is the battery's, NaN where it is not known; ``push`` (m/s²) what it takes to lean against wind.
        """
        flown, full = flying.flown, self._config.planning.thrust_share * self._config.vehicle.thrust_max
        left = full * self._left(voltage)
        reasons = [(self._within(flying, stamp, left), f"the battery gives {voltage:.1f} V")]
        if self.held:
            reasons.append((0.0, self.held))
        if push > CALM:
            reasons.append((self._within(flying, stamp, left - push), f"the wind takes {push:.1f} m/s²"))
        by_id = {gate.gate_id: gate for gate in gates}
        for gate_id, time in zip(flown.gate_ids, flown.gate_times, strict=True):
            ahead = flown.stamp + time - stamp
            if gate_id in by_id and 0.0 < ahead <= self._config.planning.pace_ahead:
                reasons.append(self._gate(by_id[gate_id], shape))
        rate, why = min(reasons)
        if rate >= 1.0:
            return 1.0, "nothing is in the way"
        return max(rate, self._config.planning.pace_min), why

    def changes(self, stamp: float, rate: float, wanted: float) -> bool:
        """Whether ``wanted`` is worth leaving the present ``rate`` for."""
        if wanted <= rate - BAND:
            self._faster_since = math.inf
            return True
        if wanted < rate + BAND and not (wanted == 1.0 and rate < 1.0):
            self._faster_since = math.inf
            return False
        self._faster_since = min(self._faster_since, stamp)
        return stamp >= self._faster_since + PATIENCE

    def _gate(self, gate: GateEstimate, shape: GateShape) -> tuple[float, str]:
        """The opening must hold so many standard deviations of where the gate is, seen from the vehicle."""
        planning, sigma = self._config.planning, horizontal_sigma(gate)
        room = 0.5 * shape.opening - self._config.vehicle.radius
        if planning.pace_sigmas * sigma <= room:
            return 1.0, ""
        why = f"gate {gate.gate_id} is known to {sigma:.2f} m"
        return max(room, 0.0) / (planning.pace_sigmas * sigma), why

    def _left(self, voltage: float) -> float:
        """What the battery's ``voltage`` leaves of the full thrust, which goes with its square."""
        nominal = self._config.vehicle.hover_voltage
        return (voltage / nominal) ** 2 if math.isfinite(voltage) and 0.0 < voltage < nominal else 1.0

    def _within(self, flying: Paced, stamp: float, force: float) -> float:
        """The greatest rate at which the rest of the plan needs no more than the specific ``force`` F.

        At a rate s it is g + s² a, whose length must stay below F: |a|² s⁴ + 2 g·a s² + g² = F² at each moment.
        """
        if force >= self._config.planning.thrust_share * self._config.vehicle.thrust_max:
            return 1.0
        if force <= GRAVITY:
            return 0.0
        times = np.arange(flying.place(stamp), flying.plan.duration + INTERVAL, INTERVAL)
        if not times.size:
            return 1.0
        a = flying.plan.sample(times).acceleration
        square, lift = np.maximum((a * a).sum(axis=1), 1e-9), GRAVITY * a[:, 2]
        rates = (np.sqrt(lift * lift + square * (force * force - GRAVITY * GRAVITY)) - lift) / square
        return float(min(math.sqrt(rates.min()), 1.0))
