"""Scoring a vehicle file over many simulated vehicles, and searching for better gains."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit
from rich.table import Table

from flightapp.config import Config, Control, load_config
from flightapp.evaluation.control_trials import FlyAlone, Score, draws, score
from flightapp.evaluation.tables import number
from flightapp.inputs import BadInputError
from flightapp.interfaces import PlanningError
from flightapp.mission.loader import load_mission
from flightapp.modules import find
from flightapp.plan_command import line_along
from flightapp.trajectory import Trajectory
from flightapp.tuning.search import Range, pattern_search

SOUGHT = (
    "position_bandwidth",
    "position_damping",
    "height_bandwidth",
    "height_damping",
    "attitude_bandwidth",
    "yaw_bandwidth",
    "disturbance_bandwidth",
)
"""Of the control section. Not those that answer what flies in no trial, such as a tracker's drift."""
SPAN = 3.0
"""Factor by which they may change."""
HELD_OUT = 1_000_000
"""Added to the seeds of vehicles that the search never sees."""


@dataclass(frozen=True, slots=True)
class TuneOptions:
    """What the command line asks for."""

    vehicle: Path
    mission: Path
    runs: int = 50
    first_seed: int = 0
    overrides: tuple[str, ...] = ()
    search: int = 0
    """How many sets of gains to try; 0 only scores."""


@dataclass(frozen=True, slots=True)
class Tuned:
    """A score, and what the search made of it."""

    options: TuneOptions
    gains: Mapping[str, float]
    """As they are."""
    score: Score
    """On the vehicles that the search never sees."""
    better: Mapping[str, float] | None = None
    """What the search found; None without one."""
    better_score: Score | None = None
    """On the same vehicles."""

    @property
    def improved(self) -> bool:
        """Whether what was found is better where the search has not looked."""
        return self.better_score is not None and self.better_score.cost < self.score.cost


Watch = Callable[[float], None]
"""Told each cost."""


def tune(options: TuneOptions, watch: Watch = lambda _: None) -> Tuned:
    """Score the vehicle file, and search if that is asked for; the same for the same seeds. Raises `BadInputError`."""
    mission = load_mission(options.mission)
    config = load_config(options.vehicle, mission.settings, options.overrides)
    try:
        line = line_along(mission.track, config)
    except PlanningError as error:
        raise BadInputError(f"{options.mission}: there is no line to fly: {error}") from None
    seed, runs = options.first_seed, options.runs
    gains = {name: value for name in SOUGHT if (value := float(getattr(config.control, name))) > 0.0}
    before = scored(config, line, runs, HELD_OUT + seed)
    if options.search == 0:
        return Tuned(options, gains, before)

    def cost(point: Mapping[str, float]) -> float:
        value = scored(with_gains(config, point), line, runs, seed).cost
        watch(value)
        return value

    found, _ = pattern_search(cost, gains, _ranges(gains), options.search)
    better = {name: float(f"{value:.3g}") for name, value in found.items()}
    return Tuned(options, gains, before, better, scored(with_gains(config, better), line, runs, HELD_OUT + seed))


def scored(config: Config, line: Trajectory, runs: int, first_seed: int) -> Score:
    """How ``runs`` drawn vehicles fly ``line`` with the controller of ``config``, in gusts and a tracker's noise."""
    fly: FlyAlone = find("simulators", "vehicle")
    controller = find("controllers", config.control.controller)(config)
    return score([fly(config, controller, line, replace(one, noise=1.0)) for one in draws(runs, first_seed)])


def with_gains(config: Config, gains: Mapping[str, float]) -> Config:
    """``config`` with other ``gains`` in its control section."""
    return config.model_copy(update={"control": config.control.model_copy(update=dict(gains))})


def _ranges(gains: Mapping[str, float]) -> list[Range]:
    """Within the configuration's own bounds."""
    ranges = []
    for name, value in gains.items():
        bounds = Control.model_fields[name].metadata
        low = max((float(b.gt) for b in bounds if hasattr(b, "gt")), default=0.0)
        high = min((float(b.le) for b in bounds if hasattr(b, "le")), default=float("inf"))
        ranges.append(Range(name, max(value / SPAN, 1.001 * low), min(value * SPAN, high)))
    return ranges


def tuned_tables(tuned: Tuned) -> list[Table]:
    """The scores, and the gains where others were sought."""
    scores = Table("", "vehicles", "RMSE median, m", "RMSE worst, m", "off the line at most, m", "lost")
    rows = [(str(tuned.options.vehicle), tuned.score)]
    if tuned.better_score is not None:
        rows.append(("found", tuned.better_score))
    for name, one in rows:
        numbers = (number(value, 4) for value in (one.rmse, one.worst, one.error))
        scores.add_row(name, str(one.runs), *numbers, str(one.crashes))
    if tuned.better is None:
        return [scores]
    gains = Table("control", "before", "found")
    for name, value in tuned.gains.items():
        gains.add_row(name, f"{value:g}", f"{tuned.better[name]:g}")
    return [scores, gains]


def tuned_json(tuned: Tuned) -> dict[str, Any]:
    """``tuned`` for other programs; SI units."""
    return {
        "vehicle": str(tuned.options.vehicle),
        "gains": dict(tuned.gains),
        "score": asdict(tuned.score),
        "found": None if tuned.better is None else dict(tuned.better),
        "found_score": None if tuned.better_score is None else asdict(tuned.better_score),
    }


def write_gains(tuned: Tuned, out: Path) -> None:
    """Write the vehicle file with the gains that were found; raises `BadInputError` where that cannot be."""
    if tuned.better is None or tuned.better_score is None:
        return
    document: Any = tomlkit.parse(tuned.options.vehicle.read_text(encoding="utf-8"))
    table = document.setdefault("control", tomlkit.table())
    for name, value in tuned.better.items():
        table[name] = value
    better, before = tuned.better_score, tuned.score
    pairs = ((better.worst, before.worst), (better.rmse, before.rmse))
    worst, median = (f"{number(now, 3)} m (before {number(was, 3)} m)" for now, was in pairs)
    note = f"tuned on {tuned.options.mission.stem}: RMSE worst {worst}, median {median} of {better.runs} vehicles"
    table.add(tomlkit.comment(note))
    try:
        out.write_text(tomlkit.dumps(document), encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"--out {out}: cannot be written: {error.strerror or error}") from None
