"""Wires a rig, the modules and the tasks together and flies one mission with them.

The only file that knows every part.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import foxglove

from flightapp import tasks
from flightapp.autopilot.guard import CommandGuard
from flightapp.autopilot.sender import SenderReport
from flightapp.behaviors.base import Context, Result
from flightapp.behaviors.coordinator import Coordinator
from flightapp.bus import Bus
from flightapp.channel import Topic
from flightapp.config import Config, dump_config, load_config
from flightapp.interfaces import Rig, Telling, WithFallback
from flightapp.mapping.map_file import mapped, read_map, write_map
from flightapp.messages import Event, Outcome
from flightapp.mission.drone import Drone
from flightapp.mission.loader import MissionFile, load_mission
from flightapp.mission.machine import MissionMachine
from flightapp.mission.orders import Orders, signalled
from flightapp.mission.rehearsal import Rehearsed, rehearse
from flightapp.mission.supervisor import Ending, Supervisor
from flightapp.modules import find
from flightapp.perception.camera import CameraModel
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.planning.line import Line
from flightapp.planning.navigator import Navigator
from flightapp.realtime import RealtimeSession, describe, undisturbed
from flightapp.recording.applog import AppLog
from flightapp.recording.live import served
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog
from flightapp.retuning import Retuner
from flightapp.safety.monitor import Monitor
from flightapp.safety.watch import Watch as HealthWatch
from flightapp.timing import KernelTicker, Ticker
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
    live: str = ""
    """HOST:PORT at which to serve the live view; empty for none."""


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight that has ended."""

    mission: str
    seed: int
    ending: Ending
    duration: float
    """s, of the flight by its own clock."""
    wall: float
    """s that it took; in virtual time much less."""
    out: Path
    log_error: str
    """Why the log is not complete; empty where it is."""


def prepare(plan: FlightPlan) -> tuple[MissionFile, Config]:
    """Load and check all of ``plan``'s inputs; raises `BadInputError`."""
    mission = load_mission(plan.mission)
    config = load_config(plan.vehicle, mission.settings, plan.overrides)
    with_map(told(mission.track, config), config)
    mission.set_parameters(config)
    for kind, name in _modules(config).items():
        find(kind, name)
    return mission, config


def dry_run(plan: FlightPlan) -> tuple[list[Rehearsed], Result]:
    """What the mission of ``plan`` would do, without a vehicle; raises `BadInputError` as a flight would."""
    mission, config = prepare(plan)
    return rehearse(mission, config, with_map(told(mission.track, config), config))


def fly(plan: FlightPlan, watch: Watch | None = None) -> Flown:
    """Fly ``plan`` to its end and leave flight.mcap, config.toml and app.log in its directory.

    While it flies SIGINT and SIGTERM have it land, and SIGHUP has it read its files anew.
    """
    return fly_prepared(plan, prepare(plan), watch)


def fly_prepared(
    plan: FlightPlan,
    prepared: tuple[MissionFile, Config],
    watch: Watch | None = None,
    orders: Orders | None = None,
) -> Flown:
    """Fly what `prepare` made of ``plan``; ``orders`` are somebody else's, and signals then are too."""
    mission, config = prepared
    rig_class = find("rigs", plan.rig)

    async def main(context: foxglove.Context | None) -> Flown:
        known = with_map(told(mission.track, config), config)
        warm_up(config, known, choose_modules(config, known, config.camera.model()))
        session = RealtimeSession(config.realtime)
        with session.adopting("the link"):
            rig: Rig = rig_class(config, mission.track, plan.seed)
        plan.out.mkdir(parents=True, exist_ok=True)
        text = dump_config(config)
        (plan.out / "config.toml").write_text(text, encoding="utf-8")
        track = mission.track.model_dump_json()
        header = {"mission": mission.name, "seed": str(plan.seed), "track": track, "config": text}
        opening, create = mission.track.gate.opening, rig.computer.create
        log = FlightLog(plan.out / "flight.mcap", header=header, opening=opening, create=create, context=context)
        recorder = Recorder(log, threaded=plan.realtime)
        entries = {"outcome": Outcome.PROCESS_FAILURE.value, "reason": "not started"}
        try:
            with AppLog(plan.out / "app.log") as app_log, _ticker(config, plan.realtime) as ticker:
                load = partial(load_config, plan.vehicle, mission.settings, plan.overrides)
                flight = _wire(mission, config, load, rig, recorder, app_log, ticker, watch, plan.out, orders)
                begin, wall = tasks.now(), time.perf_counter()
                with undisturbed(), session if plan.realtime else nullcontext():
                    ending = await flight.run(session if plan.realtime else None)
                entries = {"outcome": ending.outcome.value, "reason": ending.reason, **flight.report()}
        finally:
            error = _close(recorder, entries)
        wall = time.perf_counter() - wall
        return Flown(mission.name, plan.seed, ending, tasks.now() - begin, wall, plan.out, error)

    factory = rig_class.loop_factory(plan.realtime)
    with served(plan.live, mission.name) as context, asyncio.Runner(loop_factory=factory) as runner:
        return runner.run(main(context))


def _close(recorder: Recorder, entries: dict[str, str]) -> str:
    """Close the log; why it is not complete, or empty."""
    try:
        recorder.close(**entries)
    except OSError as error:
        return str(error)
    return ""


def _ticker(config: Config, realtime: bool) -> Ticker:
    return KernelTicker(config.control.rate) if realtime else Ticker(config.control.rate)


@dataclass(frozen=True, slots=True)
class _Flight:
    """Everything connected, ready to fly."""

    run: Callable[[RealtimeSession | None], Awaitable[Ending]]
    """With the session of a flight on the wall clock."""
    report: Callable[[], dict[str, str]]
    """How sender and controller did, for the log's header."""


def _wire(
    mission: MissionFile,
    config: Config,
    load: Callable[[], Config],
    rig: Rig,
    recorder: Recorder,
    app_log: AppLog,
    ticker: Ticker,
    watch: Watch | None,
    out: Path,
    orders: Orders | None,
) -> _Flight:
    """Connect everything."""
    bus, line = Bus(), Line()
    _record(recorder, bus, rig, config)
    bus.event.tap(app_log.write)
    rig.autopilot.notices.tap(bus.event.publish)
    if isinstance(rig.camera, Telling):
        rig.camera.notices.tap(bus.event.publish)
    known = with_map(rig.survey(told(mission.track, config)), config)
    modules = choose_modules(config, known, rig.camera.model)
    machine = MissionMachine(bus.phase, bus.event)
    context = Context(bus, config, rig.autopilot, line, machine, known, modules.guard.release)
    coordinator = Coordinator(context)
    drone = Drone(context, coordinator, mission.set_parameters(config))
    if watch is not None:
        watch(bus, rig)

    async def run(session: RealtimeSession | None) -> Ending:
        with signalled() if orders is None else nullcontext(orders) as given, given:
            return await follow(session, given)

    async def follow(session: RealtimeSession | None, given: Orders) -> Ending:
        errors = partial(_log_error, recorder, app_log)
        rate = config.control.rate
        watched = HealthWatch(bus, rig.autopilot, line, rig.computer, ticker, rate, out, errors, tasks.now())
        work: dict[str, Coroutine[Any, Any, None]] = {
            "camera": tasks.camera(rig, bus),
            "detection": tasks.detection(rig, bus, modules, config, known),
            "estimation": tasks.estimation(rig, bus, modules.estimator),
            "mapping": tasks.mapping(bus, modules.estimator),
            "planning": tasks.planning(rig, bus, modules, config, line),
            "control": tasks.control(rig, bus, modules, line, ticker),
            "health": tasks.health(bus, watched, Monitor(config, bool(known.passage))),
            "tuning": tasks.tuning(rig, bus, Retuner(config, modules.controller, load), given),
        }
        if session is not None:
            work["load"] = tasks.load(bus)
            bus.event.publish(Event(tasks.now(), "realtime", describe(session.report)))
        supervisor = Supervisor(context, coordinator, modules.guard, modules.navigator.caution)
        try:
            return await supervisor.run(work, rig.autopilot, lambda: mission.run(drone), given)
        finally:
            if track := mapped(known, modules.estimator.places()):
                write_map(out / "map.toml", track)
            await rig.autopilot.close()
            rig.worker.close()
            await rig.close()

    return _Flight(run, partial(_entries, modules, ticker))


def _entries(modules: tasks.Modules, ticker: Ticker) -> dict[str, str]:
    """How the sender did, and for how many commands another controller stood in, where one may."""
    entries = {"sender": SenderReport(ticker.statistics(), modules.guard.counts).entry()}
    if isinstance(modules.controller, WithFallback):
        entries["fallbacks"] = str(sum(modules.controller.fallbacks.values()))
    return entries


def _log_error(recorder: Recorder, app_log: AppLog) -> str:
    error = recorder.error or app_log.error
    return "" if error is None else str(error)


def _modules(config: Config) -> dict[str, str]:
    """The name of the module of each kind."""
    return {
        "detectors": config.detection.detector,
        "estimators": config.estimation.estimator,
        "planners": config.planning.planner,
        "controllers": config.control.controller,
    }


def choose_modules(config: Config, track: Track, camera: CameraModel) -> tasks.Modules:
    """The modules that ``config`` names, for a ``track`` as it is known before the flight."""
    return tasks.Modules(
        detector=find("detectors", config.detection.detector)(config, track),
        gate_pose=GatePoseSolver(config, track, camera),
        estimator=find("estimators", config.estimation.estimator)(config, track),
        navigator=Navigator(config, track),
        planner=find("planners", config.planning.planner)(config),
        controller=find("controllers", config.control.controller)(config),
        guard=CommandGuard(config),
    )


def told(track: Track, config: Config) -> Track:
    """``track`` as far as flight code may know it: without the gates' places where these are to be found out."""
    return track if config.mission.gates_known else track.without_places()


def with_map(track: Track, config: Config) -> Track:
    """``track`` with its gates as the map of an earlier flight has them, if one is to be used."""
    return read_map(Path(config.mission.map), track) if config.mission.map else track


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
        bus.load,
        bus.stage,
        rig.autopilot.status,
        rig.autopilot.imu,
    ]
    if rig.truth is not None:
        topics += [rig.truth.motion, rig.truth.passages, rig.truth.collisions, rig.truth.gates, rig.truth.arrivals]
    for topic in topics:
        recorder.tap(topic)
    if config.recording.images:
        recorder.tap(bus.frame, every=config.recording.image_every)
