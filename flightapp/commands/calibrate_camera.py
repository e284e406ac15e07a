"""The commands that find out, take over and hand on a camera's intrinsics: parse, call one function, print."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import camera_calibration_command as command
from flightapp import results
from flightapp.calibration.board import Board
from flightapp.calibration.exchange import read_calibration, to_opencv
from flightapp.calibration.settings_file import camera_settings, write_settings
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
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.perception.camera import Lens

console = Console()

OpencvFile = Annotated[Path | None, typer.Option("--opencv", help="also write OpenCV's YAML here")]
Out = Annotated[Path | None, typer.Option(help="vehicle file to write: --vehicle's with the new [camera]")]


def camera(
    source: Annotated[
        str | None,
        typer.Argument(help="/dev/videoN, csi:N, a URL, a directory, a video or a log; default: camera.source"),
    ] = None,
    lens: Annotated[Lens | None, typer.Option(help="default: camera.lens")] = None,
    dictionary: Dictionary = "5X5_100",
    columns: Columns = 11,
    rows: Rows = 7,
    square: Square = 24.0,
    marker: MarkerSize = 18.0,
    seconds: Annotated[float, typer.Option(min=5.0, help="s to look at a live camera, at most")] = 180.0,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    out: Out = None,
    opencv: OpencvFile = None,
    force: Annotated[bool, typer.Option("--force", help="write a result that is not to be relied on, too")] = False,
    json_file: JsonFile = None,
) -> None:
    """Calibrate a camera with a ChArUco board; exit status 0 only if the result is to be relied on."""
    config = load_config(vehicle, None, overrides or ())
    named = source or config.camera.source
    if not named:
        raise BadInputError("name the camera: flightapp calibrate camera SOURCE, or camera.source in the vehicle file")
    board = Board(dictionary, columns, rows, 1e-3 * square, 1e-3 * marker)
    result = command.calibrate_camera(named, config.camera, lens or config.camera.lens, board, seconds, _tell)
    console.print(*command.camera_tables(result), sep="\n")
    results.write_json(json_file, command.camera_json(result))
    for text in result.shortfalls:
        _tell(f"coverage too poor: {text}")
    if result.shortfalls and not force:
        _tell("nothing was written (--force writes it all the same)" if out or opencv else "not to be relied on")
        raise typer.Exit(1)
    model = result.found.model
    if out is not None:
        note = f"calibrated: {result.found.rms:.3f} px RMS over {len(result.found.views)} images"
        write_settings(out, vehicle, "camera", camera_settings(model), note)
    if opencv is not None:
        results.write_text(opencv, to_opencv(model), "--opencv")
    if out is None:
        for key, value in camera_settings(model).items():
            _tell(f"set camera.{key} = {value!r}".replace("'", '"'))
    raise typer.Exit(1 if result.shortfalls else 0)


def take_over(
    file: Annotated[Path, typer.Argument(help="OpenCV's YAML, or Kalibr's camchain.yaml")],
    out: Annotated[Path, typer.Option(help="vehicle file to write: --vehicle's with the new [camera]")],
    vehicle: Vehicle = None,
    camera: Annotated[str, typer.Option(help="which of a camchain's cameras")] = "cam0",
) -> None:
    """Take over a camera that OpenCV or Kalibr calibrated."""
    model = read_calibration(file, camera)
    write_settings(out, vehicle, "camera", camera_settings(model), f"from {file.name}")
    _tell(f"written: {out}; the mount is not in it: flightapp calibrate mount")


def export(
    vehicle: Annotated[Path, typer.Argument(help="vehicle file")],
    out: Annotated[Path, typer.Argument(help="OpenCV YAML to write")],
) -> None:
    """Write a vehicle's camera as OpenCV's YAML."""
    results.write_text(out, to_opencv(load_config(vehicle).camera.model()), "OUT")


def _tell(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
