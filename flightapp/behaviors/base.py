"""What every behavior shares: validated parameters, preconditions, progress, and an outcome with its reason."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field

from flightapp.bus import Bus
from flightapp.config import Config
from flightapp.config.fields import Finite
from flightapp.frames import Vector
from flightapp.inputs import validate
from flightapp.interfaces import Autopilot, Limits, PlanningError
from flightapp.messages import Outcome, Phase
from flightapp.mission.machine import MissionMachine
from flightapp.planning.below import Below
from flightapp.planning.braking import Brakes
from flightapp.planning.line import Line
from flightapp.track import Track

BRAKE_LEAD = 0.02
"""s from the decision to stop to the beginning of the braking."""
FRAME_AGE = 1.0
"""s, an image older than this shows that the camera delivers none."""


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

    def halt(self) -> None:
        """Give up what was to be reached: brake along the line, to where nothing stands below, and stay there."""
        self.bus.goal.publish(None)
        flown = self.line.latest
        if flown is None:
            return
        stamp = max(self.now() + BRAKE_LEAD, flown.stamp)
        gate_map = self.bus.gate_map.latest
        below = Below(self.config, self.track, gate_map.gates if gate_map else ())
        braked = Brakes(self.config).brake(flown, stamp, self.limits, below.free)
        if braked is None:
            return
        try:
            self.line.accept(braked)
        except PlanningError:
            return  # it is flown to its end instead, which is at rest as well
        self.bus.trajectory.publish(braked)


class Parameters(BaseModel):
    """What a behavior can be asked to do, with bounds and units."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    timeout: Finite | None = Field(None, gt=0.0, le=3600.0, description="s; default: the behavior's own")


P = TypeVar("P", bound=Parameters)


class Behavior(ABC, Generic[P]):
    """One thing the drone can do.

    A subclass names its `Parameters` class in `accepts`, says with the class variables below when and beside what it
    may be active, and implements `run`, which must stand being cancelled anywhere and being called again after that.
    Another package adds one through the entry point group ``flightapp.behaviors``.
    """

    name: ClassVar[str]
    accepts: ClassVar[type[Parameters]] = Parameters
    phases: ClassVar[frozenset[Phase]] = frozenset({Phase.FLYING})
    """Phases of the mission in which it may be activated."""
    fresh: ClassVar[tuple[str, ...]] = ("state",)
    """What must be up to date: "state", all the time; "camera", when it is activated."""
    moves: ClassVar[bool] = True
    """Whether it holds the motion command, which only one behavior can."""
    priority: ClassVar[int] = 50
    """One of higher priority stops those that it can't be beside."""
    needs: ClassVar[tuple[str, ...]] = ("takeoff",)
    """Behaviors that are activated for it, with their default parameters, where the phase is not yet one of its own."""
    excludes: ClassVar[frozenset[str]] = frozenset()
    """Behaviors that it can't be beside, other than those that move the vehicle as well."""

    def __init__(self, context: Context, **parameters: object) -> None:
        """Raises `BadInputError` for parameters that it has not, or that are out of their bounds."""
        self.context = context
        self.parameters = cast(P, validate(self.accepts, parameters, f"behavior {self.name}"))

    @property
    def timeout(self) -> float:
        """s after which it ends as TIME_OUT."""
        return self.context.config.race.timeout if self.parameters.timeout is None else self.parameters.timeout

    @property
    def progress(self) -> float:
        """How much of it is done, 0 to 1."""
        return 0.0

    @property
    def destination(self) -> Vector | None:
        """(3,) m, world: where the vehicle will be when all goes well; None: where it was."""
        return None

    @property
    def leads_to(self) -> Phase | None:
        """The phase of the mission after it when all goes well; None: as before."""
        return None

    @abstractmethod
    async def run(self) -> Result:
        """Do it; raise for a failure of its inputs or algorithms."""

    def stopped(self) -> None:
        """Leave the vehicle in safety after `run` was cancelled: brake along the line, if it is one's own."""
        if self.moves:
            self.context.halt()

    def off_course(self) -> str:
        """Why what happens is not what was to happen, as long as it is so; empty where all is well."""
        return ""

    def refusal(self) -> str:
        """Why it can't be activated now; empty when it can."""
        phase, now = self.context.machine.phase, self.context.now()
        if phase not in self.phases:
            return f"{self.name} needs the phase {' or '.join(sorted(self.phases))}, but it is {phase}"
        frame = self.context.bus.frame.latest
        if "camera" in self.fresh and (frame is None or now - frame.stamp > FRAME_AGE):
            age = "none has come" if frame is None else f"the newest is {now - frame.stamp:.1f} s old"
            return f"{self.name} needs the camera's images, but {age}"
        return self.missing()

    def missing(self) -> str:
        """Which of the inputs that it needs all the time is not there; empty where all are."""
        state, now = self.context.bus.state.latest, self.context.now()
        if "state" not in self.fresh:
            return ""
        if state is None:
            return f"{self.name} needs a vehicle state, but there is none yet"
        if (age := now - state.stamp) > self.context.config.safety.state_timeout:
            return f"{self.name} needs a vehicle state, but the newest is {age:.2f} s old"
        if state.doubt:
            return f"{self.name} needs a vehicle state, but it is not to be trusted: {state.doubt}"
        return ""
