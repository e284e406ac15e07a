"""The command `flightapp sim-autopilot`."""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp.commands.options import Overrides, Vehicle
from flightapp.config import load_config
from flightapp.modules import find
from flightapp.track import load_track

console = Console()


class Vision(StrEnum):
    """Who feeds the simulated vehicle's own estimator."""

    INTERNAL = "internal"
    EXTERNAL = "external"


def sim_autopilot(
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    track: Annotated[
        Path | None, typer.Option(help="a track to stand in, such as missions/tracks/one_gate.toml")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything random in the simulation")] = 0,
    remote: Annotated[
        list[str] | None, typer.Option(help="127.0.0.1:PORT to send MAVLink to, instead of ports 14540 and 14550")
    ] = None,
    param: Annotated[list[str] | None, typer.Option(help="NAME=VALUE, over PX4's parameters")] = None,
    vision: Annotated[
        Vision, typer.Option(help="internal: its tracker is wired to it; external: a client sends the poses")
    ] = Vision.INTERNAL,
    poses: Annotated[
        str | None, typer.Option(help="127.0.0.1:PORT or a path, where the tracker's poses go (sensors.pose_address)")
    ] = None,
) -> None:
    """Serve the simulated vehicle alone over MAVLink, for a ground station or another client, until ^C."""
    config = load_config(vehicle, None, overrides or ())
    stand = None if track is None else load_track(track)
    find("simulators", "px4")(
        config,
        stand,
        seed=seed,
        remotes=remote or (),
        parameters=param or (),
        vision=vision,
        poses_to=poses,
        announce=partial(console.print, highlight=False, soft_wrap=True),
    )
