"""What every behavior shares: one run, watched, with an outcome and a reason."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from flightapp.bus import Bus
from flightapp.config import Config
from flightapp.interfaces import Autopilot, Limits
from flightapp.messages import Event, Outcome, Phase
from flightapp.mission.machine import MissionMachine
from flightapp.planning.line import Line
from flightapp.track import Track


@dataclass(frozen=True, slots=True)
class Result:
    """How a behavior ended, and why in words."""

    outcome: Outcome
    reason: str

    @property
    def achieved(self) -> bool:
        """Whether it did what it was to do."""
        return self.outcome is Outcome.GOAL_ACHIEVED


@dataclass(frozen=True, slots=True)
class Context:
    """What behaviors act with."""

    bus: Bus
    config: Config
    autopilot: Autopilot
    line: Line
    machine: MissionMachine
    track: Track
    release_guard: Callable[[], None]

    def now(self) -> float:
        """The present stamp."""
        return asyncio.get_running_loop().time()

    @property
    def limits(self) -> Limits:
        """The limits that plans must keep to."""
        race = self.config.race
        return Limits(race.v_max, race.a_max, self.config.vehicle.yaw_rate_max)


class Behavior(ABC):
    """One thing the drone can do.

    Subclasses set `name`, `phases` (in which it may be activated) and `needs_state` (whether there must be a
    vehicle state then), and implement `run`. ``timeout`` is in seconds.
    """

    name = "behavior"
    phases: frozenset[Phase] = frozenset({Phase.FLYING})
    needs_state = True

    def __init__(self, context: Context, timeout: float) -> None:
        self.context = context
        self.timeout = timeout

    @abstractmethod
    async def run(self) -> Result:
        """Do it; raise for a failure of its inputs or algorithms."""

    def refusal(self) -> str:
        """Why it can't be activated now; empty when it can."""
        phase = self.context.machine.phase
        if phase not in self.phases:
            return f"{self.name} needs the phase {' or '.join(sorted(self.phases))}, but it is {phase}"
        if self.needs_state and self.context.bus.state.latest is None:
            return f"{self.name} needs a vehicle state, but there is none yet"
        return ""


class Coordinator:
    """Activates behaviors one at a time, watches over them and reports how they ended."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._active: Behavior | None = None

    @property
    def active(self) -> Behavior | None:
        """The behavior that holds the motion command."""
        return self._active

    async def run(self, behavior: Behavior) -> Result:
        """Activate ``behavior`` and wait until it ends; never raises but for cancellation."""
        if self._active is not None:
            result = Result(Outcome.PROCESS_FAILURE, f"{behavior.name} refused: {self._active.name} is active")
        elif refusal := behavior.refusal():
            result = Result(Outcome.PROCESS_FAILURE, refusal)
        else:
            self._active = behavior
            try:
                result = await self._watch(behavior)
            finally:
                self._active = None
        text = f"{behavior.name}: {result.outcome}: {result.reason}"
        self._context.bus.event.publish(Event(self._context.now(), "behavior", text))
        return result

    async def _watch(self, behavior: Behavior) -> Result:
        try:
            async with asyncio.timeout(behavior.timeout):
                return await behavior.run()
        except TimeoutError:
            return Result(Outcome.TIME_OUT, f"not done within {behavior.timeout:g} s")
        except Exception as error:  # whatever an algorithm raises must end in a landing, not in a fall
            return Result(Outcome.PROCESS_FAILURE, f"{type(error).__name__}: {error}")
