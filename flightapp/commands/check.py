"""The command `flightapp check`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import results
from flightapp.commands.options import Overrides
from flightapp.config import dump_config, load_config
from flightapp.mission.loader import load_mission
from flightapp.track import load_track

console = Console()


def check(
    files: Annotated[
        list[Path] | None, typer.Argument(help="missions (.py, .toml), tracks and vehicle files (.toml)")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Validate files without flying; print the effective configuration."""
    for file in files or []:
        if file.suffix == ".py" or results.looks_like_mission(file):
            mission = load_mission(file)
            mission.set_parameters(load_config(None, mission.settings, overrides or ()))
            console.print(f"# {file}: a mission on track '{mission.track.name}'", highlight=False)
        elif results.looks_like_track(file):
            console.print(f"# {file}: track '{load_track(file).name}'", highlight=False)
        else:
            print(dump_config(load_config(file, None, overrides or ())))
    if not files:
        print(dump_config(load_config(None, None, overrides or ())))
