"""The whole data flow on one page: each task awaits its input, calls one algorithm, publishes the result."""

import asyncio
import contextlib
import math
import resource
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from flightapp.autopilot.guard import CommandGuard, GuardTrippedError, Refusal
from flightapp.autopilot.sender import SenderReport
from flightapp.bus import Bus
from flightapp.channel import Reader
from flightapp.config import Config
from flightapp.estimation.recent import RecentStates
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.interfaces import Controller, Detector, Estimator, Planner, PlanningError, PlanRequest, Rig
from flightapp.messages import (
    Event,
    Frame,
    Phase,
    PlanReport,
    ProcessLoad,
    RateCommand,
    Sightings,
    Stage,
    StageTime,
    VehicleState,
)
from flightapp.mission.orders import Orders
from flightapp.perception.gate_pose import GatePoseSolver
from flightapp.perception.regions import expected_regions
from flightapp.planning.answer import Answerer
from flightapp.planning.goal import Goal
from flightapp.planning.line import Line
from flightapp.planning.navigator import Navigator
from flightapp.realtime import resident
from flightapp.retuning import Retuner
from flightapp.safety.faults import Fault, FaultKind
from flightapp.safety.monitor import Monitor
from flightapp.safety.watch import Watch
from flightapp.sensors.frames import FrameIntake
from flightapp.timing import Ticker
from flightapp.track import Track
from flightapp.trajectory import Trajectory

LOOK = 0.1
"""s, longest time between looks at the pace of what is flown."""
MAP_INTERVAL = 0.2
"""s, after which the gate map is told anew though nothing was seen: it grows less certain."""

TRIPPED = {
    Refusal.TAKEN_OVER: FaultKind.TAKEN_OVER,
    Refusal.STATE_OLD: FaultKind.POSE_LOST,
    Refusal.LINK_LOST: FaultKind.LINK_LOST,
    Refusal.NO_STATUS: FaultKind.LINK_LOST,
}
"""The fault behind what the guard refuses; any other is that there is no sound command."""


@dataclass(frozen=True, slots=True)
class Modules:
    """The algorithms that were chosen by name."""

    detector: Detector
    gate_pose: GatePoseSolver
    estimator: Estimator
    navigator: Navigator
    planner: Planner
    controller: Controller
    guard: CommandGuard


def now() -> float:
    """The event loop's time."""
    return asyncio.get_running_loop().time()


async def camera(rig: Rig, bus: Bus) -> None:
    """Hardware → frames, without those that a frozen camera repeats."""
    intake = FrameIntake()
    async for frame in rig.camera.frames():
        if intake.take(frame):
            bus.frame.publish(frame)
        if intake.notice:
            bus.event.publish(Event(now(), "camera", intake.notice))


async def detection(rig: Rig, bus: Bus, modules: Modules, config: Config, track: Track) -> None:
    """Frames → sightings, the newest frame only."""
    frames, states = Reader(bus.frame), RecentStates()
    bus.state.tap(states.add)
    while True:
        frame = await frames.newest()
        begun, regions = now(), None
        gate_map, state = bus.gate_map.latest, states.at(frame.stamp)
        missing = gate_map is None or len(gate_map.gates) < len(track.passage)
        whole = missing or frame.sequence % config.detection.full_frame_every == 0
        if frame.image is not None and config.detection.region_of_interest and not whole and gate_map and state:
            regions = expected_regions(
                gate_map.gates, state.position, state.orientation, rig.camera.model, track.gate, config.detection
            )
        bus.sightings.publish(await rig.worker.run("detection", partial(_see, modules, regions, frame)))
        bus.stage.publish(StageTime(now(), Stage.DETECTION, frame.stamp, begun))


def _see(modules: Modules, regions: Sequence[Vector] | None, frame: Frame) -> Sightings:
    markers = modules.detector.detect(frame, regions)
    return Sightings(frame.stamp, frame.sequence, markers, modules.gate_pose.solve(frame.stamp, markers))


async def estimation(rig: Rig, bus: Bus, estimator: Estimator) -> None:
    """Poses, and the inertial sensors where there are none → vehicle state.

    The autopilot gets the poses too, but for those that leave the state in doubt, and for those that follow them on the
    way down: what contradicted itself once may have been believed since, and the autopilot lands better without.
    """
    doubted = False

    def publish(state: VehicleState | None) -> None:
        if state is not None:
            bus.state.publish(state)

    rig.autopilot.imu.tap(lambda sample: publish(estimator.on_imu(sample)))
    try:
        async for sample in rig.tracker.poses():
            bus.pose.publish(sample)
            state = estimator.on_pose(sample)
            if state is not None:
                doubted = bool(state.doubt) or (doubted and bus.phase.latest in (Phase.LANDING, Phase.ABORTED))
            if not doubted:
                rig.autopilot.send_pose(sample)
            publish(state)
    finally:
        bus.event.publish(Event(now(), "poses", rig.tracker.report()))


async def mapping(bus: Bus, estimator: Estimator) -> None:
    """Sightings → gate map, as soon as the state has passed them."""
    bus.gate_map.publish(estimator.gate_map(now()))
    sightings = Reader(bus.sightings)
    while True:
        seen = await sightings.newest()
        while bus.state.latest is None or bus.state.latest.stamp < seen.stamp:
            await bus.state.next()
        last = bus.gate_map.latest
        if estimator.on_sightings(seen) or last is None or now() - last.stamp > MAP_INTERVAL:
            bus.gate_map.publish(estimator.gate_map(now()))
        for notice in estimator.take_notices():
            bus.event.publish(Event(now(), "gate", notice))


async def planning(rig: Rig, bus: Bus, modules: Modules, config: Config, line: Line) -> None:
    """Goal and gate map → trajectory, when either has changed enough, and the pace at which it is flown."""
    changed = asyncio.Event()
    bus.goal.tap(lambda _: changed.set())
    bus.gate_map.tap(lambda _: changed.set())
    answerer = Answerer(config, modules.planner, modules.navigator.pacer)
    while True:
        # Not wait_for: before Python 3.12 it loses a cancellation that comes together with what it waits for.
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LOOK):
                await changed.wait()
        changed.clear()
        goal = bus.goal.latest
        if goal is None or line.latest is None:
            continue
        request = modules.navigator.request(now(), goal, bus.gate_map.latest, line)
        if request is not None:
            asked = now()
            try:
                await _plan(rig, bus, modules, answerer, goal, request, line)
            except PlanningError as error:
                bus.plan.publish(PlanReport(asked, now() - asked, False, str(error)))
        if line.latest is not None:
            _repace(rig, bus, modules, goal, line)


async def _plan(
    rig: Rig, bus: Bus, modules: Modules, answerer: Answerer, goal: Goal, request: PlanRequest, line: Line
) -> None:
    """Answer ``request`` and fly on with it; raises `PlanningError`."""
    navigator, asked = modules.navigator, now()
    gates = navigator.known(bus.gate_map.latest)
    try:
        work = partial(answerer.answer, goal, request, gates, navigator.rate, navigator.has_time)
        choice = await rig.worker.run("plan", work)
    finally:
        navigator.took(now() - asked)
    if line.latest is None:
        raise PlanningError("the line was given up meanwhile")
    if (wanted := bus.goal.latest) is None or wanted.serial != goal.serial:
        raise PlanningError("the goal was given up meanwhile")
    if now() > choice.flown.stamp:
        raise PlanningError(f"late by {now() - choice.flown.stamp:.3f} s")
    if detour := navigator.detour(goal, request, choice, line):
        raise PlanningError(detour)
    line.accept(choice.flown)
    navigator.accepted(goal, request, choice)
    bus.trajectory.publish(choice.flown)
    bus.plan.publish(PlanReport(asked, now() - asked, True, ""))


def _repace(rig: Rig, bus: Bus, modules: Modules, goal: Goal, line: Line) -> None:
    """Fly on faster or slower along the same plan, where that is wanted."""
    status = rig.autopilot.status.latest
    voltage = status.voltage if status is not None else math.nan
    navigator = modules.navigator
    change = navigator.repace(now(), goal, bus.gate_map.latest, line, voltage, modules.controller.push)
    if change is not None:
        choice, text = change
        line.accept(choice.flown)
        navigator.repaced(choice)
        bus.trajectory.publish(choice.flown)
        bus.event.publish(Event(now(), "plan", text))


async def control(rig: Rig, bus: Bus, modules: Modules, line: Line, ticker: Ticker) -> None:
    """Line and state → body rates and thrust, through the guard, to the autopilot."""
    guard = modules.guard
    try:
        while True:
            await ticker.tick()
            stamp = now()
            try:
                _send(rig, bus, modules, line, stamp)
            except GuardTrippedError as error:
                line.clear()
                bus.fault.publish(Fault(stamp, TRIPPED.get(error.cause, FaultKind.NO_COMMAND), str(error)))
            if report := guard.take_report():
                bus.event.publish(Event(stamp, "guard", report))
            bus.tick.publish(stamp)
    finally:
        if report := modules.controller.report:
            bus.event.publish(Event(now(), "control", report))
        bus.event.publish(Event(now(), "guard", SenderReport(ticker.statistics(), guard.counts).line()))


def _send(rig: Rig, bus: Bus, modules: Modules, line: Line, stamp: float) -> None:
    """One tick; raises `GuardTrippedError` when the autopilot is to fly on by itself."""
    trajectory, state = line.at(stamp), bus.state.latest
    if trajectory is None or state is None:
        modules.controller.reset()
        modules.guard.rest()
        return
    command = _command(rig, modules, stamp, state, trajectory)
    if command is not None:
        rig.autopilot.send(command)
        bus.stage.publish(StageTime(now(), Stage.COMMAND, state.stamp, stamp))
        bus.setpoint.publish(trajectory.setpoint(stamp))
        bus.command.publish(command)


def _command(
    rig: Rig, modules: Modules, stamp: float, state: VehicleState, trajectory: Trajectory
) -> RateCommand | None:
    """What to send, None for nothing; raises `GuardTrippedError` when there is an end to it."""
    guard, status = modules.guard, rig.autopilot.status
    try:
        guard.check_state(state, stamp)
        try:
            wanted = modules.controller.command(stamp, state, trajectory)
        except Exception as error:  # a controller may be anybody's, and in flight its failure must not end the sender
            raise guard.refused(Refusal.NO_COMMAND, f"{type(error).__name__}: {error}") from error
        return guard.check(wanted, now(), status.latest)
    except GuardTrippedError as error:
        return guard.hold(error, now(), status.latest, state)


async def tuning(rig: Rig, bus: Bus, retuner: Retuner, orders: Orders) -> None:
    """When asked: the configuration, read or set anew → the controller, if all of it may change in flight."""
    bus.config.publish(retuner.config)
    while True:
        asked = await orders.retuning()
        try:
            config = await rig.worker.run("reload", partial(retuner.propose, asked.settings))
            text = f"retuned: {retuner.apply(config, asked.settings)}"
            bus.config.publish(config)
            asked.answer.set_result(text)
        except BadInputError as error:
            text = f"not retuned: {error}"
            asked.refuse(text)
        finally:
            asked.refuse("the flight is over")
        bus.event.publish(Event(now(), "tuning", text))


async def load(bus: Bus) -> None:
    """What the process takes of its computer, once a second; on the wall clock only."""
    while True:
        used = resource.getrusage(resource.RUSAGE_SELF)
        bus.load.publish(ProcessLoad(now(), used.ru_utime + used.ru_stime, float(resident())))
        await asyncio.sleep(1.0)


async def health(bus: Bus, watch: Watch, monitor: Monitor) -> None:
    """Readings of everything → faults; the guard sees to commands and states where there is a line."""
    ticker = Ticker(20.0)
    while True:
        for fault in monitor.look(watch.readings(await ticker.tick())):
            bus.fault.publish(fault)
