"""Controllers side by side: vehicle and controller alone on the paper's lines, and each term of the law on and off."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from flightapp.config import Config, Term, load_config
from flightapp.evaluation.control_trials import FlyAlone, Mismatch, draws, score
from flightapp.evaluation.paper import paper_tables
from flightapp.evaluation.tables import NONE, TextTable, number
from flightapp.mission.loader import load_mission
from flightapp.modules import find
from flightapp.plan_command import PlanOptions, plan_track
from flightapp.trajectory import Trajectory

MISSIONS = Path(__file__).parents[1] / "missions"
COURSES = (
    ("lemniscate", 3.0),
    ("lemniscate", 5.0),
    ("lemniscate", 7.0),
    ("five_gates_loop", 4.0),
    ("five_gates_loop", 10.0),
)
"""Mission and v_max, m/s."""
PAPER = {"lemniscate": 1, "five_gates_loop": 7}
"""The paper's table of tracking errors beside a course; its five gates stood elsewhere."""
CONTROLLERS = ("flatness", "mpc", "mpcc", "paper", "pd")
STIFF = {"position_bandwidth": 6.0, "height_bandwidth": 6.5}
GAINS: dict[str, dict[str, Any]] = {"paper": STIFF, "pd": STIFF}
"""What suits a controller better than the configured gains: the stiffest at which these two do not swing."""
FIRST_SEED = 7000
PATH_HEAD = ("time", "RMS", "time", "worst", "RMS", "worst RMS", "greatest", "m/s", "stood in")

Rows = list[dict[str, Any]]


def run_control_bench(
    controllers: Sequence[str] = CONTROLLERS,
    vehicle: Path | None = None,
    overrides: Sequence[str] = (),
    runs: int = 50,
    first_seed: int = FIRST_SEED,
    courses: Sequence[tuple[str, float]] = COURSES,
) -> dict[str, Any]:
    """Fly each of ``controllers`` and `flatness` without each of its terms; the result of `flightapp bench --control`.

    Each course is flown once as believed, and ``runs`` times by vehicles that are other than believed, in gusts.
    """
    fly: FlyAlone = find("simulators", "vehicle")
    cases = [*((name, "") for name in controllers), *(("flatness", term) for term in get_args(Term))]
    rows: Rows = []
    for course, v_max in courses:
        config, line = _course(course, v_max, vehicle, overrides)
        paper = _paper(course, v_max)
        for name, term in cases:
            changes = {**GAINS.get(name, {}), "without": (term,) if term else ()}
            flown = config.model_copy(update={"control": config.control.model_copy(update=changes)})
            controller = find("controllers", name)(flown)
            nominal = fly(flown, controller, line, Mismatch())
            perturbed = score([fly(flown, controller, line, mismatch) for mismatch in draws(runs, first_seed)])
            row = {"course": course, "v_max": v_max, "controller": name, "without": term, "paper": paper}
            rows.append({**row, "nominal": asdict(nominal), "perturbed": asdict(perturbed)})
    return {"runs": runs, "first_seed": first_seed, "vehicle": config.vehicle.name, "rows": rows}


def control_tables(result: dict[str, Any]) -> tuple[TextTable, TextTable, TextTable]:
    """``result`` as text: controllers by time, controllers along the path, and terms."""
    rows: Rows = result["rows"]
    runs = result["runs"]
    head = ("course", "v_max", "controller", "paper", "RMSE", "greatest", "RMSE", "worst RMSE", "greatest", "crashes")
    title = (
        f"Tracking error in m on {result['vehicle']}: paper; as believed; {runs} vehicles other than believed, in gusts"
    )
    whole = TextTable(title, head, [_cells(row) for row in rows if not row["without"]])
    courses = list(dict.fromkeys((row["course"], row["v_max"]) for row in rows))
    terms = list(dict.fromkeys(row["without"] for row in rows if row["controller"] == "flatness"))
    cells = [[term or "nothing", *(_ablated(rows, term, *course) for course in courses)] for term in terms]
    names = [f"{name} {v_max:g}" for name, v_max in courses]
    path = TextTable(
        f"Along the path on {result['vehicle']}: s to the finish and m off the path; as believed; the others",
        ("course", "v_max", "controller", *PATH_HEAD),
        [_path_cells(row) for row in rows if not row["without"]],
    )
    return (
        whole,
        path,
        TextTable("flatness without a term: RMSE as believed / worst of the others, m", ("without", *names), cells),
    )


def _course(name: str, v_max: float, vehicle: Path | None, overrides: Iterable[str]) -> tuple[Config, Trajectory]:
    mission = MISSIONS / f"{name}.py"
    settings = {**load_mission(mission).settings, "race.v_max": v_max}
    config = load_config(vehicle, settings, tuple(overrides))
    told = tuple(f"{key}={value}" for key, value in settings.items())
    track = MISSIONS / "tracks" / f"{name}.toml"
    plan = plan_track(PlanOptions(track, vehicle=vehicle, overrides=(*told, *overrides)))
    return config, plan.trajectory


def _paper(course: str, v_max: float) -> float | None:
    (table,) = (table for table in paper_tables() if table.number == PAPER[course])
    row = table.row(v_max)
    return None if row is None else row["total"]


def _cells(row: dict[str, Any]) -> list[str]:
    nominal, perturbed = row["nominal"], row["perturbed"]
    numbers = (row["paper"], nominal["rmse"], nominal["worst"], *(perturbed[key] for key in ("rmse", "worst", "error")))
    cells = [number(value, 3) for value in numbers]
    crashes = f"{perturbed['crashes']} of {perturbed['runs']}"
    return [row["course"], f"{row['v_max']:g}", row["controller"], *cells, crashes]


def _path_cells(row: dict[str, Any]) -> list[str]:
    nominal, perturbed = row["nominal"], row["perturbed"]
    times = [number(nominal["time"], 2), number(nominal["contour"], 3)]
    times += [number(perturbed[key], 2) for key in ("time", "time_worst")]
    off = [number(perturbed[key], 3) for key in ("contour", "contour_worst", "contour_error")]
    last = [number(perturbed["speed"], 2), str(perturbed["stood_in"])]
    return [row["course"], f"{row['v_max']:g}", row["controller"], *times, *off, *last]


def _ablated(rows: Rows, term: str, course: str, v_max: float) -> str:
    key = ("flatness", term, course, v_max)
    for row in rows:
        if (row["controller"], row["without"], row["course"], row["v_max"]) == key:
            lost = row["perturbed"]["crashes"]
            text = f"{number(row['nominal']['rmse'], 3)} / {number(row['perturbed']['worst'], 3)}"
            return f"{text}, {lost} lost" if lost else text
    return NONE
