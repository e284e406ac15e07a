"""What is done to the vehicle and to its autopilot where sim.faults says so."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from flightapp.config import Config
from flightapp.track import Track
from sim.autopilot import SimAutopilot
from sim.faults import TIPPING, Fault, named
from sim.pilot import Pilot
from sim.px4.modes import NavState


class VehicleFaults:
    """Lets faults of the vehicle begin and end as time goes on; ``track`` tells how everything stands."""

    def __init__(
        self, faults: Sequence[Fault], autopilot: SimAutopilot, config: Config, track: Callable[[], Track]
    ) -> None:
        self._autopilot, self._config, self._track = autopilot, config, track
        self._waiting = list(named(faults, "gust", "tipped", "battery", "pilot", "pilot_lands", "link_silent"))
        self._pilot: Pilot | None = None
        self._gusts: list[Fault] = []
        self._tipping: Fault | None = None
        self._upright = autopilot.plant.orientation
        self.tipped = False
        """Whether the vehicle was turned over, and its rotors survive the ground."""

    def run(self, now: float) -> None:
        """Do what is due up to ``now``."""
        blowing = len(self._gusts)
        self._gusts = [gust for gust in self._gusts if gust.acts(now)]
        while self._waiting and self._waiting[0].begin <= now:
            self._begin(self._waiting.pop(0))
        if self._tipping is not None:
            self._tip(self._tipping, now)
        if self._pilot is not None and self._pilot.fly(now):
            self._pilot = None
        if len(self._gusts) != blowing:
            x, y = (math.fsum(gust.amount[axis] for gust in self._gusts) for axis in range(2))
            self._autopilot.plant.blow(np.array((x, y, 0.0)))

    def _tip(self, fault: Fault, now: float) -> None:
        """Turn it on; a little at a time, as no tracker would believe a jump."""
        angle = math.radians(fault.amount[0])
        share = min((now - fault.begin) / TIPPING, 1.0)
        self._autopilot.plant.tip(self._upright, share * angle, angle / TIPPING if share < 1.0 else 0.0)
        if share == 1.0:
            self._tipping = None

    def _begin(self, fault: Fault) -> None:
        amount = fault.amount[0]
        if fault.name == "gust":
            self._gusts.append(fault)
        elif fault.name == "tipped":
            self.tipped, self._tipping, self._upright = True, fault, self._autopilot.plant.orientation
        elif fault.name == "battery":
            self._autopilot.plant.charge = amount
        elif fault.name == "pilot":
            self._autopilot.px4.pilot(NavState(int(amount)))
        elif fault.name == "pilot_lands":
            self._pilot = Pilot(self._config, self._track(), self._autopilot.px4, fault.begin + amount)
        else:
            self._autopilot.silent_until = fault.end
