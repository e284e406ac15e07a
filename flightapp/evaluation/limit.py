"""The paper's limit: four unknown gates, flown with its planning times and with ours.

"Trajectory generation spend[s] a lot of time […]. That made it not possible to complete such a small circuit at speeds
higher than 1 m/s" (section 5.2). Where gates are only found on the way, each must be planned for before it is reached.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import TextTable, number

MISSION = Path("missions/four_gates_unknown.py")
VEHICLE = Path("config/sim_f330.toml")
SPEEDS = (1.0, 2.0, 4.0)
"""m/s."""
PLANNERS: Mapping[str, tuple[float, float]] = {
    "ours": (0.06, 0.02),
    "the paper's, 6 points": (0.051, 0.094),
    "the paper's, 14 points": (0.321, 0.094),
    "the paper's, 26 points": (1.028, 0.094),
    "the paper's modules, 26 points": (1.028, 0.094),
    "the paper's modules, our times": (0.06, 0.02),
}
"""s per plan and per detection on a Jetson Xavier NX. The paper's are its table 14's. Ours are the 14 ms (race_plan)
and 1.9 ms (aruco_full) that `flightapp bench` measured on x86-64, times the factors between the paper's two computers
(3.75 and 6.2), rounded up."""
MODULES = ("planning.planner=polynomial", "control.controller=paper", "estimation.estimator=t265")
"""What the paper flew: polynomials through the gates' centres, its controller, the T265's poses."""


@dataclass(frozen=True, slots=True)
class LimitCase:
    """One speed with one planner's times."""

    planner: str
    v_max: float
    """m/s."""
    length: float = 20.0
    """m, about."""
    mission: Path = MISSION
    vehicle: Path = VEHICLE

    @property
    def label(self) -> str:
        """Of its flights."""
        return f"limit v_max={self.v_max:g} {self.planner}"

    @property
    def settings(self) -> tuple[str, ...]:
        """What is set for it."""
        plan, detection = PLANNERS[self.planner]
        speed = (f"race.v_max={self.v_max:g}", "race.a_max=6")
        modules = MODULES if self.planner.startswith("the paper's modules") else ()
        return (*speed, f"compute.plan={plan:g}", f"compute.detection={detection:g}", *modules)


LIMIT = tuple(LimitCase(planner, v_max) for planner in PLANNERS for v_max in SPEEDS)


def limit_table(flown: Sequence[tuple[LimitCase, Sequence[Mapping[str, Any]]]]) -> TextTable:
    """Successes and their mean time, by planner and v_max."""
    cells = {(case.planner, case.v_max): _cell(results) for case, results in flown}
    rows = []
    for planner, (plan, detection) in PLANNERS.items():
        name = f"{planner}: {1e3 * plan:.0f} ms a plan, {1e3 * detection:.0f} ms a detection"
        rows.append([name, *(cells.get((planner, v_max), "") for v_max in SPEEDS)])
    columns = ("planning times on a Jetson", *(f"v_max {v_max:g}" for v_max in SPEEDS))
    return TextTable("Four unknown gates: how many of the flights succeed, and their mean time", columns, rows)


def _cell(results: Sequence[Mapping[str, Any]]) -> str:
    times = [r["summary"]["elapsed"] for r in results if not (r.get("why") or why_failed(r["summary"]))]
    return f"{len(times)} of {len(results)}" + (f", {number(sum(times) / len(times), 1)} s" if times else "")
