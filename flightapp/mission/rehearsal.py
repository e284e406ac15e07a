"""A mission gone through with a vehicle that is none: what it would do, step by step, without flying."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.frames import Vector, quat_from_yaw
from flightapp.interfaces import Autopilot
from flightapp.messages import AutopilotStatus, FlightMode, Outcome, Phase, VehicleState
from flightapp.mission.drone import BehaviorFailedError, Drone
from flightapp.mission.loader import MissionError, MissionFile
from flightapp.mission.machine import NEXT, MissionMachine
from flightapp.modules import find
from flightapp.planning.line import Line
from flightapp.track import Track

STEPS = 1000
"""Behaviors after which a mission is taken to have no end."""
WAITING = 3600.0
"""s of a mission's own waiting after which it is taken to wait for what comes only in flight."""


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """One behavior that a mission would activate."""

    name: str
    parameters: dict[str, Any]
    """Those that are not the default."""
    destination: Vector
    """(3,) m, world: where the vehicle would be then."""
    note: str
    """Why it is there, or is refused; mostly empty."""


class NullAutopilot:
    """A vehicle that is ready and full of charge. No behavior runs, so that nothing is ever asked of it."""

    def __init__(self) -> None:
        self.status: Topic[AutopilotStatus] = Topic("status")
        self.status.publish(AutopilotStatus(0.0, FlightMode.HOLD, False, True, True, 16.0, 1.0))


@dataclass(frozen=True, slots=True)
class Done:
    """In place of an activation: over as soon as it has begun, with the best of results."""

    behavior: Behavior[Any]
    outcome: Result
    done: bool = True
    progress: float = 1.0

    async def result(self) -> Result:
        """The best of results."""
        return self.outcome

    async def stop(self, why: str) -> Result:
        """The same."""
        return self.outcome


class Prompter:
    """Takes activations as a coordinator does, writes them down and lets them have been."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.steps: list[Rehearsed] = []
        self._at = np.array(context.track.start.position)
        self._tell()

    @contextlib.asynccontextmanager
    async def activate(self, behavior: Behavior[Any]) -> AsyncIterator[Done | Result]:
        """``behavior`` as if it had gone well; a `Result` where it would be refused."""
        yield await self._go(behavior, "")

    async def _go(self, behavior: Behavior[Any], note: str) -> Done | Result:
        machine = self._context.machine
        for name in behavior.needs if machine.phase not in behavior.phases else ():
            needed = find("behaviors", name)(self._context)
            if machine.phase in needed.phases:
                await self._go(needed, f"needed by {behavior.name}")
        if machine.phase not in behavior.phases:
            needs = " or ".join(sorted(behavior.phases))
            refused = f"refused: it needs the phase {needs}, but it would be {machine.phase}"
            self._note(behavior, refused)
            return Result(Outcome.PROCESS_FAILURE, refused)
        if behavior.destination is not None:
            self._at = behavior.destination
        if behavior.leads_to is not None:
            _lead(machine, behavior.leads_to)
        self._note(behavior, note)
        await asyncio.sleep(0.0)
        self._tell()
        return Done(behavior, Result(Outcome.GOAL_ACHIEVED, "rehearsed"))

    def _note(self, behavior: Behavior[Any], note: str) -> None:
        if len(self.steps) >= STEPS:
            endless = Result(Outcome.TIME_OUT, f"the mission has not ended after {STEPS} behaviors")
            raise BehaviorFailedError(behavior.name, endless)
        given = behavior.parameters.model_dump(exclude_defaults=True)
        self.steps.append(Rehearsed(behavior.name, given, self._at, note))

    def _tell(self) -> None:
        """The state that the mission may look at."""
        rest, yaw = np.zeros(3), self._context.track.start.yaw
        state = VehicleState(self._context.now(), self._at, quat_from_yaw(yaw), rest, rest, np.zeros((9, 9)))
        self._context.bus.state.publish(state)


def rehearse(mission: MissionFile, config: Config, track: Track) -> tuple[list[Rehearsed], Result]:
    """What ``mission`` would do on ``track``, as far as it is known before the flight, and how it would end.

    Every behavior goes well and takes no time.
    """

    async def main() -> tuple[list[Rehearsed], Result]:
        bus = Bus()
        machine = MissionMachine(bus.phase, bus.event)
        context = Context(bus, config, cast(Autopilot, NullAutopilot()), Line(), machine, track, lambda: None)
        prompter = Prompter(context)
        try:
            async with asyncio.timeout(WAITING):
                await mission.run(Drone(context, prompter, mission.set_parameters(config)))
        except TimeoutError:
            why = f"it has waited for {WAITING:g} s for what comes only in flight"
            return prompter.steps, Result(Outcome.TIME_OUT, why)
        except BehaviorFailedError as error:
            return prompter.steps, Result(error.result.outcome, str(error))
        except MissionError as error:
            return prompter.steps, Result(Outcome.PROCESS_FAILURE, str(error))
        ending = "mission complete" if machine.phase in (Phase.LANDED, Phase.IDLE) else "then it would be landed"
        return prompter.steps, Result(Outcome.GOAL_ACHIEVED, ending)

    with asyncio.Runner(loop_factory=find("rigs", "sim").loop_factory(False)) as runner:
        return runner.run(main())


def _lead(machine: MissionMachine, target: Phase) -> None:
    """Through the phases, one after the other, to ``target``."""
    while machine.phase is not target:
        machine.go(next(phase for phase in NEXT[machine.phase] if phase is not Phase.IDLE), 0.0, "rehearsed")
