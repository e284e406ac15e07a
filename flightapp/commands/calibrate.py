"""The commands that find out what the configuration must say: parse, call one function, print."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import delay_command, results
from flightapp.commands import calibrate_camera, calibrate_mount

calibrate = typer.Typer(no_args_is_help=True, help="Find out what the configuration must say of the sensors.")
console = Console()


@calibrate.callback()
def group() -> None:
    """Find out what the configuration must say of the sensors."""


@calibrate.command()
def delay(
    log: Annotated[Path, typer.Argument(help="a flight.mcap, or poses as .csv, .txt or .tum")],
    against: Annotated[
        Path | None,
        typer.Option(help="a gyroscope's angular velocities by the same clock: .csv, or another flight log"),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="also write the result here")] = None,
) -> None:
    """Find the tracker's delay (sensors.delay) from a recording of quick, irregular turning."""
    found = delay_command.calibrate_delay(log, against)
    for line in delay_command.delay_lines(found):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    results.write_json(json_file, delay_command.delay_json(found))


calibrate.command("camera")(calibrate_camera.camera)
calibrate.command("import")(calibrate_camera.take_over)
calibrate.command("export")(calibrate_camera.export)
calibrate.command("mount")(calibrate_mount.mount)
calibrate.command("tracker")(calibrate_mount.tracker)
