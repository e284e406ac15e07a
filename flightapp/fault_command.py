"""Every row of the fault table in every stage it names, provoked in simulation at random moments."""

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from flightapp import app
from flightapp.bus import Bus
from flightapp.campaign.pool import Lost, work
from flightapp.config import Config
from flightapp.evaluation.fault_matrix import CLEARING, Cell, Seen, Stages, Statement, departure, due
from flightapp.evaluation.forced import is_forced, turned_over
from flightapp.evaluation.sweep import wilson_interval
from flightapp.inputs import BadInputError
from flightapp.interfaces import Rig
from flightapp.messages import AutopilotStatus, Collision, GroundTruth, Phase
from flightapp.modules import find
from flightapp.safety.faults import Fault, FaultKind, Stage
from flightapp.safety.table import TABLE, reaction_to
from flightapp.track import Track

THINNED = 4
"""Of the true motion every fourth sample is kept."""
SETTINGS = ("sim.camera='corners'",)
"""Of all flights: what the camera's images look like matters to none of them."""


@dataclass(slots=True)
class _Observer:
    """Takes notes of a flight, beside its log, which may be what fails."""

    motion: list[tuple[float, ...]] = field(default_factory=list)
    statuses: list[AutopilotStatus] = field(default_factory=list)
    passages: list[tuple[float, int]] = field(default_factory=list)
    collisions: list[Collision] = field(default_factory=list)
    told: dict[FaultKind, float] = field(default_factory=dict)
    begun: dict[Stage, float] = field(default_factory=lambda: {Stage.PREFLIGHT: 0.0})
    commands: list[tuple[float, float]] = field(default_factory=list)
    now: float = 0.0
    landed: float = math.inf
    _count: int = 0

    def watch(self, bus: Bus, rig: Rig) -> None:
        """Look at everything."""
        assert rig.truth is not None
        rig.truth.motion.tap(self._moved)
        rig.truth.passages.tap(lambda passage: self.passages.append((passage.stamp, passage.gate_id)))
        rig.truth.collisions.tap(self.collisions.append)
        rig.autopilot.status.tap(self.statuses.append)
        bus.command.tap(lambda command: self.commands.append((command.stamp, float(np.hypot(*command.rates[:2])))))
        bus.fault.tap(self._told)
        bus.phase.tap(self._entered)

    def _moved(self, truth: GroundTruth) -> None:
        self.now = truth.stamp
        self._count += 1
        if self._count % THINNED == 1:
            speed = float(np.linalg.norm(truth.velocity))
            _, x, y, _ = truth.orientation.tolist()
            tilt = math.acos(max(1.0 - 2.0 * (x * x + y * y), -1.0))
            self.motion.append((truth.stamp, *truth.position.tolist(), speed, tilt))

    def _told(self, fault: Fault) -> None:
        if not fault.over:
            self.told.setdefault(fault.kind, fault.stamp)

    def _entered(self, phase: Phase) -> None:
        if phase is Phase.LANDED:
            self.landed = self.now
        self.begun.setdefault(Stage.of(phase), self.now)

    def seen(self) -> Seen:
        """The notes."""
        motion = np.array(self.motion)
        stages = Stages(self.begun, min(self.landed, self.now), tuple(stamp for stamp, _ in self.passages))
        return Seen(
            stamp=motion[:, 0],
            position=motion[:, 1:4],
            speed=motion[:, 4],
            tilt=motion[:, 5],
            statuses=self.statuses,
            passages=[gate_id for _, gate_id in self.passages],
            collisions=self.collisions,
            commands=np.array(self.commands).reshape(-1, 2),
            told=self.told,
            stages=stages,
        )


@dataclass(frozen=True, slots=True)
class FaultOptions:
    """What the command line asks for."""

    mission: Path
    runs: int = 20
    first_seed: int = 0
    only: tuple[FaultKind, ...] = ()
    vehicle: Path | None = None
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Job:
    """One flight with one fault."""

    kind: FaultKind
    stage: Stage
    seed: int
    stages: Stages
    """When those of the same flight without faults begin and end."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of it."""

    departure: str
    """Of what the table states; empty for none."""
    crash: str
    forced: bool = False


def cells_of(only: Sequence[FaultKind]) -> list[tuple[FaultKind, Stage]]:
    """What is flown: every fault (or ``only`` some) in every stage that the table names."""
    return [(kind, stage) for kind, row in TABLE.items() if not only or kind in only for stage in row.reactions]


def run_faults(options: FaultOptions, workers: int, advance: Callable[[bool], None]) -> list[Cell]:
    """Fly all of it in ``workers`` processes, seed by seed; the matrix."""
    plan = app.FlightPlan(options.mission, Path(), "sim", options.vehicle, (*SETTINGS, *options.overrides))
    app.prepare(plan)
    wanted = cells_of(options.only)
    cells = {(kind, stage): Cell(kind, stage, reaction_to(kind, stage)) for kind, stage in wanted}
    seeds = range(options.first_seed, options.first_seed + options.runs)
    references: dict[int, Stages] = {}
    for number, stages in work(partial(fly_without, plan), seeds, workers):
        if isinstance(stages, Lost):
            raise BadInputError(
                f"{plan.mission}: seed {seeds[number]} does not fly without faults either: {stages.why}"
            )
        references[seeds[number]] = stages
    jobs = [Job(kind, stage, seed, references[seed]) for seed in seeds for kind, stage in wanted]
    for number, outcome in work(partial(fly_with_fault, plan), jobs, workers):
        job = jobs[number]
        done = Outcome(outcome.why, "") if isinstance(outcome, Lost) else outcome
        cells[job.kind, job.stage].add(job.seed, done.departure, done.crash, done.forced)
        advance(not done.departure and not done.crash)
    return list(cells.values())


def fly_without(plan: app.FlightPlan, seed: int) -> Stages:
    """When the stages of a flight without faults begin; raises `BadInputError` where that fails already.

    What is told and calls for nothing, as what is noticed of a hard touchdown, is no failure.
    """
    seen, _ = _fly(replace(plan, seed=seed))
    grave = [kind for kind, stamp in seen.told.items() if reaction_to(kind, seen.stages.at(stamp)).gravity > 0]
    if set(seen.stages.begin) != set(Stage) or seen.collisions or grave:
        told = ", ".join(seen.told) or "it did not come to its end"
        raise BadInputError(f"{plan.mission}: seed {seed} does not fly without faults either: {told}")
    return seen.stages


def _fly(plan: app.FlightPlan) -> tuple[Seen, app.Flown]:
    cv2.setNumThreads(1)
    observer = _Observer()
    with tempfile.TemporaryDirectory() as scratch:
        flown = app.fly(replace(plan, out=Path(scratch)), observer.watch)
    return observer.seen(), flown


def fly_with_fault(plan: app.FlightPlan, job: Job) -> Outcome:
    """One flight with one fault at a random moment of its stage."""
    kind, stage, seed, stages = job.kind, job.stage, job.seed, job.stages
    trial = find("simulators", "faults")[kind][stage]
    random = Random(f"{seed} {kind} {stage}")
    moment = trial.moment(stage, stages, random)
    provocation = trial.provoke(moment, random)
    entries = [list(entry) for entry in provocation.entries]
    overrides = (*plan.overrides, *trial.settings, f"sim.faults={entries}")
    broken = replace(plan, seed=seed, overrides=overrides)
    mission, config = app.prepare(broken)
    said = Statement(
        kind=kind,
        stage=stage,
        reaction=reaction_to(kind, stage),
        begin=moment,
        notice=trial.notice,
        end=moment + provocation.lasts,
        gates=[gate.id for gate in mission.track.passage] * config.mission.laps,
        finish=np.array(mission.track.finish),
        pushed=trial.pushed,
        slow=config.planning.pace_min * config.race.v_max,
        patience=config.safety.hold_time,
        clearing=CLEARING if stage is Stage.FLYING and not TABLE[kind].adrift else 0.0,
    )
    try:
        seen, _ = _fly(broken)
    except BadInputError:
        raise
    except Exception as error:  # a flight that breaks is what this looks for
        return Outcome(f"{type(error).__name__}: {error}", "")
    hit = sorted({touch.obstacle for touch in seen.collisions})
    forced = bool(hit) and (trial.forced or _forced(seen, moment, provocation, mission.track, config))
    crash = f"hit {', '.join(hit)}" if hit and not forced else ""
    where = f"at {moment:.2f} s: "
    # What is broken before it can react is not asked how it reacts.
    unseen = forced and not trial.forced and min(touch.stamp for touch in seen.collisions) < due(said)
    why = "" if unseen else departure(said, seen)
    return Outcome(where + why if why else "", where + crash if crash else "", forced)


def _forced(seen: Seen, moment: float, provocation: Any, track: Track, config: Config) -> bool:
    """Whether what was hit first could not be avoided from the ``moment`` on; what follows from it doesn't count."""
    first = min(seen.collisions, key=lambda touch: touch.stamp)
    if provocation.blind is None or first.stamp < moment:
        return False
    row = int(np.searchsorted(seen.stamp, moment))
    if turned_over(float(seen.tilt[row]), seen.turning(moment), provocation.held):
        return True
    place, speed = seen.position[row], float(seen.speed[row])
    return is_forced(track, first.obstacle, place, speed, config.vehicle.radius, provocation.blind)


def fault_table(cells: Sequence[Cell]) -> Table:
    """The matrix, and what was not as stated."""
    table = Table("fault", "phase", "reaction", "runs", "as stated", "95 % interval", "crashes", "forced")
    for cell in cells:
        low, high = wilson_interval(cell.as_stated, cell.runs)
        interval = f"{100.0 * low:.0f} to {100.0 * high:.0f} %"
        counts = (str(cell.runs), str(cell.as_stated), interval, str(cell.crashes), str(cell.forced))
        table.add_row(cell.kind, cell.stage, cell.reaction, *counts, style=None if cell.good else "red")
    return table


def departures_table(cells: Sequence[Cell]) -> Table:
    """What was seen instead, seed by seed."""
    table = Table("fault", "phase", "seed", "what was seen instead")
    for cell in cells:
        for seed, why in cell.departures:
            table.add_row(cell.kind, cell.stage, str(seed), why)
    return table
