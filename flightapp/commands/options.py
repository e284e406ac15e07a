"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

Mission = Annotated[Path, typer.Argument(help="a mission, such as missions/five_gates.py")]
Vehicle = Annotated[Path | None, typer.Option("--vehicle", help="vehicle file, such as config/sim_racer.toml")]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="section.key=value, over all files")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="also write the result here")]
Connect = Annotated[
    str | None, typer.Option("--connect", help="fly a real vehicle at udpin://HOST:PORT or serial:///dev/NAME:BAUD")
]
Dictionary = Annotated[str, typer.Option(help="of the board's markers: OpenCV's, without DICT_")]
Columns = Annotated[int, typer.Option(help="squares of the board across")]
Rows = Annotated[int, typer.Option(help="squares of the board down")]
Square = Annotated[float, typer.Option(help="mm, side of the board's squares, as measured on the print")]
MarkerSize = Annotated[float, typer.Option("--marker", help="mm, side of the board's markers")]
