"""The commands that find out where camera and tracker sit in the body: parse, call one function, print."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import mount_command, results, tracker_command
from flightapp.calibration.board import Board
from flightapp.calibration.settings_file import write_settings
from flightapp.commands.options import (
    Columns,
    Dictionary,
    JsonFile,
    MarkerSize,
    Overrides,
    Rows,
    Square,
    Vehicle,
)
from flightapp.inputs import BadInputError

console = Console()


def mount(
    recording: Annotated[Path, typer.Argument(help="a flight.mcap or its directory; else images, with --poses")],
    poses: Annotated[Path | None, typer.Option(help="poses by the same clock: .csv, .txt, .tum or .mcap")] = None,
    track: Annotated[Path | None, typer.Option(help="whose gate stands still; default: the log's own")] = None,
    gate: Annotated[int | None, typer.Option(help="its id; default: the one that was seen most")] = None,
    board: Annotated[bool, typer.Option("--board", help="a ChArUco board stands still, not a gate")] = False,
    dictionary: Dictionary = "5X5_100",
    columns: Columns = 11,
    rows: Rows = 7,
    square: Square = 24.0,
    marker: MarkerSize = 18.0,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write: --vehicle's with the new mount")] = None,
    force: Annotated[bool, typer.Option("--force", help="write a result that is not to be relied on, too")] = False,
    json_file: JsonFile = None,
) -> None:
    """Find where the camera sits in the body; exit status 0 only if the result is to be relied on."""
    if board and (track is not None or gate is not None):
        raise BadInputError("what stands still is --board, or a gate (--track, --gate), not both")
    target = Board(dictionary, columns, rows, 1e-3 * square, 1e-3 * marker) if board else None
    question = mount_command.MountQuestion(recording, poses, vehicle, tuple(overrides or ()), target, track, gate)
    answer = mount_command.calibrate_mount(question)
    for line in mount_command.mount_lines(answer):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    results.write_json(json_file, mount_command.mount_json(answer))
    poor = bool(answer.found.shortfalls)
    if out is not None and (force or not poor):
        write_settings(out, vehicle, "camera", answer.settings, f"from {answer.found.sights} images")
    raise typer.Exit(1 if poor else 0)


def tracker(
    log: Annotated[Path, typer.Argument(help="a flight.mcap or its directory; or poses as .csv, .txt or .tum")],
    against: Annotated[
        Path | None, typer.Option(help="angular velocities of a gyroscope by the same clock: .csv, or another log")
    ] = None,
    vehicle: Vehicle = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write: --vehicle's with the new mount")] = None,
    force: Annotated[bool, typer.Option("--force", help="write a result that is not to be relied on, too")] = False,
    json_file: JsonFile = None,
) -> None:
    """Find how the tracker sits in the body, from quick turning; exit status 0 only if it is to be relied on."""
    answer = tracker_command.calibrate_tracker(log, against)
    for line in tracker_command.tracker_lines(answer):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    results.write_json(json_file, tracker_command.tracker_json(answer))
    poor = bool(answer.found.shortfalls)
    if out is not None and (force or not poor):
        write_settings(out, vehicle, "sensors", answer.settings, "calibrated")
    raise typer.Exit(1 if poor else 0)
