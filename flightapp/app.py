"""Wires a rig, the modules and the tasks together and flies one mission with them.

The only file that knows every part.
"""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightapp import tasks
from flightapp.autopilot.guard import CommandGuard
from flightapp.behaviors.base import Context, Coordinator
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.config import Config, dump_config, load_config
from flightapp.interfaces import Rig
from flightapp.mapping.slam import SlamMapper
from flightapp.messages import Outcome
from flightapp.mission.drone import Drone
from flightapp.mission.loader import MissionFile, load_mission
from flightapp.mission.machine import MissionMachine
from flightapp.mission.supervisor import Ending, Supervisor
from flightapp.modules import find
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.planning.line import Line
from flightapp.planning.navigator import Navigator
from flightapp.recording.applog import AppLog
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog
from flightapp.timing import Ticker
from flightapp.track import Track
from flightapp.warmup import warm_up

Watch = Callable[[Bus, Rig], None]
"""Called once everything is wired, to attach a display."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """What to fly, with what, and where to leave the record."""

    mission: Path
    out: Path
    rig: str = "sim"
    vehicle: Path | None = None
    overrides: tuple[str, ...] = ()
    seed: int = 0
    realtime: bool = False


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight that has ended."""

    mission: str
    seed: int
    ending: Ending
    duration: float
    """s, of the whole flight by its own clock."""
    out: Path


def prepare(plan: FlightPlan) -> tuple[MissionFile, Config]:
    """Load and check all of ``plan``'s inputs; raises `BadInputError`."""
    mission = load_mission(plan.mission)
    return mission, load_config(plan.vehicle, mission.settings, plan.overrides)


def fly(plan: FlightPlan, watch: Watch | None = None) -> Flown:
    """Fly ``plan`` to its end and leave flight.mcap, config.toml and app.log in its directory."""
    mission, config = prepare(plan)
    rig_class = find("rigs", plan.rig)
    plan.out.mkdir(parents=True, exist_ok=True)
    (plan.out / "config.toml").write_text(dump_config(config), encoding="utf-8")
    header = {
        "mission": mission.name,
        "seed": str(plan.seed),
        "track": mission.track.model_dump_json(),
        "config": dump_config(config),
    }

    async def main() -> tuple[Ending, float]:
        rig: Rig = rig_class(config, mission.track, plan.seed)
        log = FlightLog(plan.out / "flight.mcap", header=header, opening=mission.track.gate.opening)
        recorder = Recorder(log, threaded=plan.realtime)
        with AppLog(plan.out / "app.log") as app_log:
            ending = Ending(Outcome.PROCESS_FAILURE, "not started")
            try:
                ending = await _fly(mission, config, rig, recorder, app_log, watch)
            finally:
                recorder.close(outcome=ending.outcome, reason=ending.reason)
        return ending, asyncio.get_running_loop().time()

    with asyncio.Runner(loop_factory=rig_class.loop_factory(plan.realtime)) as runner:
        ending, duration = runner.run(main())
    return Flown(mission.name, plan.seed, ending, duration, plan.out)


async def _fly(
    mission: MissionFile, config: Config, rig: Rig, recorder: Recorder, app_log: AppLog, watch: Watch | None
) -> Ending:
    bus, line = Bus(), Line()
    _record(recorder, bus, rig, config)
    bus.event.tap(app_log.write)
    bus.fault.tap(bus.event.publish)
    known = rig.survey(mission.track)
    modules = choose_modules(config, known, rig)
    spare = choose_modules(config, known, rig)
    warm_up(config, known, rig.camera.model, spare.estimator, spare.mapper, spare.planner, spare.controller)
    machine = MissionMachine(bus.phase, bus.event)
    context = Context(bus, config, rig.autopilot, line, machine, known, modules.guard.release)
    drone = Drone(context, Coordinator(context))
    if watch is not None:
        watch(bus, rig)
    ticker = Ticker(config.control.rate)
    supervisor = Supervisor(context, modules.guard)
    work: dict[str, Coroutine[Any, Any, None]] = {
        "camera": tasks.camera(rig, bus),
        "detection": tasks.detection(rig, bus, modules, config, known),
        "estimation": tasks.estimation(rig, bus, modules.estimator),
        "mapping": tasks.mapping(rig, bus, modules.mapper),
        "planning": tasks.planning(rig, bus, modules, line),
        "control": tasks.control(rig, bus, modules, line, ticker),
        "health": tasks.health(bus, config, line),
    }
    try:
        return await supervisor.run(work, rig.autopilot, lambda: mission.run(drone))
    finally:
        await rig.autopilot.close()


def choose_modules(config: Config, track: Track, rig: Rig) -> tasks.Modules:
    """The modules that ``config`` names, for a ``track`` as it is known before the flight."""
    return tasks.Modules(
        detector=find("detectors", config.detection.detector)(config, track),
        gate_pose=GatePoseSolver(config, track, rig.camera.model),
        estimator=find("estimators", config.estimation.estimator)(config),
        mapper=SlamMapper(config, track, tasks.now()),
        navigator=Navigator(config),
        planner=find("planners", config.planning.planner)(config),
        controller=find("controllers", config.control.controller)(config),
        guard=CommandGuard(config),
    )


def _record(recorder: Recorder, bus: Bus, rig: Rig, config: Config) -> None:
    topics: list[Topic[Any]] = [
        bus.sightings,
        bus.pose,
        bus.state,
        bus.gate_map,
        bus.trajectory,
        bus.plan,
        bus.setpoint,
        bus.command,
        bus.event,
        rig.autopilot.status,
    ]
    if rig.truth is not None:
        topics += [rig.truth.motion, rig.truth.passages, rig.truth.collisions, rig.truth.gates]
    for topic in topics:
        recorder.tap(topic)
    if config.recording.images:
        recorder.tap(bus.frame, every=config.recording.image_every)
