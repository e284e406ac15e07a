"""A flight as the service tells of it."""

import math
from typing import Any

from flightapp.bus import Bus
from flightapp.config import Config
from flightapp.interfaces import Rig
from flightapp.mission.loader import MissionFile
from flightapp.retuning import live_fields
from flightapp.safety.faults import Fault, FaultKind


class Picture:
    """What is known of the flight of a ``mission``; read from another thread than the flight's, holding nothing up."""

    def __init__(self, mission: MissionFile, config: Config, bus: Bus, rig: Rig) -> None:
        self._mission, self._config, self._bus, self._rig = mission, config, bus, rig
        self._faults: dict[FaultKind, Fault] = {}
        self._begun: float | None = None
        bus.fault.tap(self._take_fault)

    def begin(self, stamp: float) -> None:
        """The sender's first tick was at ``stamp``."""
        if self._begun is None:
            self._begun = stamp

    def _take_fault(self, fault: Fault) -> None:
        if fault.over:
            self._faults.pop(fault.kind, None)
        else:
            self._faults.setdefault(fault.kind, fault)

    @property
    def time(self) -> float:
        """s since the flight began."""
        last = self._bus.tick.latest
        return 0.0 if last is None or self._begun is None else last - self._begun

    @property
    def faults(self) -> list[str]:
        """What is wrong now."""
        return [str(fault) for fault in list(self._faults.values())]

    def status(self) -> dict[str, Any]:
        """Everything, for programs; SI units."""
        bus, autopilot = self._bus, self._rig.autopilot.status.latest
        state, goal = bus.state.latest, bus.goal.latest
        gates = None if goal is None or not goal.gate_ids else [goal.passed, len(goal.gate_ids)]
        return {
            "phase": str(bus.phase.latest or "idle"),
            "behaviors": list(bus.behaviors.latest or ()),
            "time": round(self.time, 3),
            "gates": gates,
            "position": None if state is None else [round(value, 3) for value in state.position.tolist()],
            "speed": None if state is None else round(math.hypot(*state.velocity.tolist()), 3),
            "autopilot": None if autopilot is None else str(autopilot.mode),
            "armed": None if autopilot is None else autopilot.armed,
            "battery": None if autopilot is None or math.isnan(autopilot.battery) else round(autopilot.battery, 3),
            "faults": self.faults,
        }

    def line(self) -> str:
        """The same for people, in one line."""
        told = self.status()
        parts = [f"{self._mission.name}: {told['phase']}"]
        if told["behaviors"]:
            parts.append(", ".join(told["behaviors"]))
        if told["gates"] is not None:
            passed, count = told["gates"]
            parts.append(f"gate {min(passed + 1, count)} of {count}" if passed < count else f"all {count} gates passed")
        parts += [f"{told['time']:.0f} s", "; ".join(told["faults"]) or "no faults"]
        return ", ".join(parts)

    def tunables(self) -> list[dict[str, Any]]:
        """The fields that may change in flight: as they are, as they were at its start, bounds and meaning."""
        before = {one.key: one.value for one in live_fields(self._config)}
        now = live_fields(self._bus.config.latest or self._config)
        return [
            {"key": f.key, "value": f.value, "start": before[f.key], "bounds": f.bounds, "description": f.description}
            for f in now
        ]
