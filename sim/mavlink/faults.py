"""Faults of the link and of the vehicle behind it, by name: at once, or at a time."""

import heapq
import math
from collections.abc import Callable
from itertools import count
from random import Random

from flightapp.inputs import BadInputError
from sim.fault_values import Value, names, nav_state, seconds, share, switch, unknown
from sim.faults import KINDS
from sim.px4.model import Px4


class Faults:
    """What is broken now; the endpoint asks here before it sends, receives or obeys.

    ``time`` is the clock of the schedule, ``seed`` decides which packets are lost.
    """

    def __init__(self, px4: Px4, time: Callable[[], float], seed: int = 0) -> None:
        self._px4 = px4
        self._time = time
        self._random = Random(seed)
        self._silent_until = -math.inf
        self._counter = count()
        self._scheduled: list[tuple[float, int, Callable[[], object]]] = []
        self.loss_in = self.loss_out = 0.0
        """Share of the packets to and from the vehicle that are lost."""
        self.latency = self.jitter = 0.0
        """s that packets take both ways, and how much longer at most."""
        self.telemetry_nan = False
        """Measured and estimated numbers are NaN."""
        self.setpoints_ignored = self.vision_ignored = False
        self.acknowledged_early = False
        """Mode commands are accepted before the vehicle answers, as PX4 did until its pull request 27343."""
        self.missing: frozenset[str] = frozenset()
        """Parameters that this vehicle doesn't know."""
        self._kinds: dict[str, Callable[[Value], Callable[[], object]]] = {
            "loss": lambda value: self._setting(share(value), "loss_in", "loss_out"),
            "loss_in": lambda value: self._setting(share(value), "loss_in"),
            "loss_out": lambda value: self._setting(share(value), "loss_out"),
            "latency": lambda value: self._setting(seconds(value), "latency"),
            "jitter": lambda value: self._setting(seconds(value), "jitter"),
            "silence": self._silence,
            "telemetry_nan": lambda value: self._setting(switch(value), "telemetry_nan"),
            "setpoints_ignored": lambda value: self._setting(switch(value), "setpoints_ignored"),
            "vision_ignored": lambda value: self._setting(switch(value), "vision_ignored"),
            "acknowledged_early": lambda value: self._setting(switch(value), "acknowledged_early"),
            "missing": lambda value: self._setting(names(value), "missing"),
            "reboot": lambda _: px4.reboot,
            "battery": lambda _: px4.fail_battery,
            "pilot": self._pilot,
            "pilot_lost": lambda _: px4.lose_pilot,
            "refuse_arming": self._refuse,
        }

    @property
    def names(self) -> tuple[str, ...]:
        """All faults that there are."""
        return tuple(self._kinds)

    def apply(self, name: str, value: Value = None) -> None:
        """Let ``name`` happen now; raises `BadInputError` for an unknown name or a value that doesn't fit."""
        self._prepare(name, value)()

    def schedule(self, stamp: float, name: str, value: Value = None) -> None:
        """Let ``name`` happen at ``stamp``; raises `BadInputError` at once."""
        heapq.heappush(self._scheduled, (stamp, next(self._counter), self._prepare(name, value)))

    def run(self, now: float) -> None:
        """Do what was scheduled up to ``now``."""
        while self._scheduled and self._scheduled[0][0] <= now:
            heapq.heappop(self._scheduled)[2]()

    @property
    def silent(self) -> bool:
        """Whether no packet gets through."""
        return self._time() < self._silent_until

    @property
    def harmless(self) -> bool:
        """Whether packets get through at once, all of them."""
        return not (self.latency or self.jitter or self.loss_in or self.loss_out or self.silent)

    def delay(self, loss: float) -> float | None:
        """s that a packet takes; None if it is lost."""
        if self.silent or (loss and self._random.random() < loss):
            return None
        return self.latency + (self._random.random() * self.jitter if self.jitter else 0.0)

    def _prepare(self, name: str, value: Value) -> Callable[[], object]:
        kind = self._kinds.get(name)
        if kind is None:
            if name in KINDS:
                raise BadInputError(f"fault '{name}' is of a world in the same process; fly without --mavlink")
            raise unknown(name, self._kinds)
        try:
            return kind(value)
        except ValueError as error:
            raise BadInputError(f"fault '{name}': {error}") from None

    def _setting(self, value: object, *attributes: str) -> Callable[[], object]:
        def change() -> None:
            for attribute in attributes:
                setattr(self, attribute, value)

        return change

    def _silence(self, value: Value) -> Callable[[], object]:
        duration = seconds(value)

        def begin() -> None:
            self._silent_until = self._time() + duration

        return begin

    def _pilot(self, value: Value) -> Callable[[], object]:
        state = nav_state(value)
        return lambda: self._px4.pilot(state)

    def _refuse(self, value: Value) -> Callable[[], object]:
        reason = value if isinstance(value, str) else ("Simulated failure" if switch(value) else None)
        return lambda: self._px4.refuse_arming(reason or None)
