"""One flight of many: what it is, how it is flown alone, and what is kept of it."""

import json
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from flightapp import app
from flightapp.evaluation.summary import summarise, why_failed
from flightapp.evaluation.trace import trace
from flightapp.inputs import BadInputError
from flightapp.recording.reader import read_flight

Result = Mapping[str, Any]
"""What is kept of a flight: "label", "seed", "parameters" and "command"; then "summary" and "reason" (and "fallbacks",
"trace"), or "why" where it broke."""


@dataclass(frozen=True, slots=True)
class Run:
    """One flight of many."""

    plan: app.FlightPlan
    """With its seed; where it leaves its record does not matter."""
    label: str = ""
    """Which of the combinations that are flown it belongs to."""
    parameters: tuple[tuple[str, str], ...] = ()
    """What was chosen for that combination, by name; in ``plan`` already."""
    traced: bool = False
    """Whether the motion is kept too, thinned."""

    @property
    def command(self) -> str:
        """What flies it alone."""
        plan = self.plan
        words = ["flightapp", "fly", str(plan.mission), "--sim"]
        words += [] if plan.vehicle is None else ["--vehicle", str(plan.vehicle)]
        words += [word for override in plan.overrides for word in ("--set", override)]
        return shlex.join([*words, "--seed", str(plan.seed)])

    @property
    def known(self) -> dict[str, Any]:
        """What can be said of its result before it is flown."""
        kept = {"label": self.label, "seed": self.plan.seed, "parameters": dict(self.parameters)}
        return kept | {"command": self.command}

    def lost(self, why: str) -> Result:
        """Its result where there is none."""
        return self.known | {"why": why}


def fly_run(run: Run) -> str:
    """Fly ``run`` and tell its `Result` as JSON; the same run gives the same text. Raises `BadInputError`."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            flown = app.fly(replace(run.plan, out=Path(scratch)))
            flight = read_flight(flown.out / "flight.mcap")
            result = run.known | {"summary": summarise(flight), "reason": flown.ending.reason}
            if "fallbacks" in flight.header:
                result["fallbacks"] = int(flight.header["fallbacks"])
            if run.traced:
                result["trace"] = trace(flight)
        except BadInputError:
            raise
        except Exception as error:  # one broken flight must not lose the others
            result = dict(run.lost(f"{type(error).__name__}: {error}"))
    return json.dumps(result, ensure_ascii=False, allow_nan=False)


def failure(result: Result) -> str:
    """Why the flight does not count as a success; empty if it does."""
    if "why" in result:
        return str(result["why"])
    return why_failed(result["summary"])
