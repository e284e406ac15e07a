"""Two recorded paths beside each other: how far one is off the other."""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from flightapp.evaluation.alignment import Align, Alignment, AlignmentError, align
from flightapp.evaluation.paths import MAX_DIFFERENCE, Pair, TimedPath, associate, interpolate
from flightapp.evaluation.pose_errors import Unit, absolute_errors, relative_errors
from flightapp.evaluation.tables import TextTable, number
from flightapp.inputs import BadInputError

_STEP = re.compile(r"(?P<delta>\d+(\.\d*)?|\.\d+)(?P<unit>s|m|f)")
_UNITS = {"s": Unit.SECONDS, "m": Unit.METRES, "f": Unit.FRAMES}
_WORDS = {
    Align.NONE: "as it is",
    Align.FIRST: "first pose",
    Align.YAW: "yaw and place",
    Align.SE3: "SE(3)",
    Align.SIM3: "Sim(3)",
}
_SPREAD = ("rmse", "mean", "median", "std", "min", "max")


@dataclass(frozen=True, slots=True)
class Step:
    """Of relative errors."""

    delta: float
    unit: Unit


@dataclass(frozen=True, slots=True)
class Options:
    """How to compare."""

    align: Align | None = None
    """None: each way that the paths allow."""
    step: Step | None = None
    offset: float = 0.0
    """s, added to the estimate's stamps."""
    max_difference: float = MAX_DIFFERENCE
    """s between stamps that belong together."""
    interpolated: bool = False
    """Read the estimate at the reference's stamps, instead of taking the nearest poses."""


def parse_step(text: str) -> Step:
    """What "1s", "5m" or "10f" says; raises `BadInputError`."""
    form = _STEP.fullmatch(text)
    step = form and Step(float(form["delta"]), _UNITS[form["unit"]])
    if step is None or step.delta <= 0.0 or (step.unit is Unit.FRAMES and step.delta != int(step.delta)):
        raise BadInputError(f"--rpe {text}: a step is a number of seconds, metres or frames, such as 1s, 5m or 10f")
    return step


def compare(reference: TimedPath, estimate: TimedPath, options: Options) -> dict[str, Any]:
    """The errors of ``estimate`` against ``reference``, in SI units and radians; raises `BadInputError`.

    The relative errors are those of the path as aligned by ``options.align``, which only a scale can change.
    """
    true, found = _together(reference, estimate.shifted(options.offset), options)
    ways = (options.align,) if options.align else tuple(Align)
    ape, motions = {}, {}
    for how in ways:
        try:
            motion = align(true, found, how)
        except AlignmentError as error:
            if options.align:
                raise BadInputError(f"--align {how}: {error}") from None
            continue
        errors = absolute_errors(true, motion.apply(found))
        ape[how.value] = errors and asdict(errors)
        motions[how.value] = _told(motion)
    rpe = None
    if options.step is not None:
        try:
            aligned = align(true, found, options.align or Align.NONE).apply(found)
            errors = relative_errors(true, aligned, options.step.delta, options.step.unit)
        except ValueError as error:
            raise BadInputError(f"--rpe: {error}") from None
        if errors is None:
            raise BadInputError(f"--rpe: there is no step of {options.step.delta:g} {options.step.unit} in the path")
        rpe = {"delta": options.step.delta, "unit": options.step.unit.value, **asdict(errors)}
    return {
        "reference": reference.name,
        "estimate": estimate.name,
        "poses": {"reference": reference.stamp.size, "estimate": estimate.stamp.size, "compared": true.stamp.size},
        "duration": float(true.stamp[-1] - true.stamp[0]),
        "association": "interpolated" if options.interpolated else "nearest",
        "ape": ape,
        "alignment": motions,
        "rpe": rpe,
    }


def comparison_tables(result: Mapping[str, Any]) -> tuple[TextTable, ...]:
    """What `compare` found, with rotations in degrees."""
    poses = result["poses"]
    how = "read between its poses" if result["association"] == "interpolated" else "nearest in time"
    title = f"{result['estimate']}\nagainst {result['reference']}\n{poses['compared']} poses, {how}"
    rows = [row for way, errors in result["ape"].items() for row in _rows(f"APE, {_WORDS[Align(way)]}", errors)]
    rpe = result["rpe"]
    if rpe is not None:
        rows += _rows(f"RPE over {rpe['delta']:g} {rpe['unit']}", rpe)
    return (TextTable(title, ("", *_SPREAD), rows),)


def _together(reference: TimedPath, estimate: TimedPath, options: Options) -> Pair:
    if options.interpolated:
        pair = interpolate(reference, estimate)
    else:
        pair = associate(reference, estimate, options.max_difference)
    if pair[0].stamp.size == 0:
        spans = [f"{path.name} is from {path.stamp[0]:.3f} to {path.stamp[-1]:.3f} s" for path in (reference, estimate)]
        raise BadInputError(
            f"no poses of the two belong together: {spans[0]}, {spans[1]}; give --offset where their clocks differ,"
            " --max-difference where they are seldom, or --interpolate"
        )
    return pair


def _told(motion: Alignment) -> dict[str, Any]:
    return {"rotation": motion.rotation.tolist(), "translation": motion.translation.tolist(), "scale": motion.scale}


def _rows(name: str, errors: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for part, unit, scale in (("translation", "m", 1.0), ("rotation", "°", math.degrees(1.0))):
        if errors[part] is not None:
            rows.append([f"{name}, {unit}", *(number(errors[part][key], 4, scale) for key in _SPREAD)])
    return rows
