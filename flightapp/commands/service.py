"""The commands `flightapp serve`, and those that talk to it: `start`, `stop`, `abort`, `status`."""

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel
from rich.console import Console

from flightapp.commands.options import Connect, Mission, Overrides, Vehicle
from flightapp.inputs import BadInputError, validate
from flightapp.service.client import ask, socket_path
from flightapp.service.protocol import Abort, Start, Status, Stop

LOOK = 0.3
"""s between looks at how a flight goes."""
console = Console()


def serve(
    sim: Annotated[bool, typer.Option("--sim", help="fly the in-process simulation")] = False,
    mavlink: Annotated[
        bool, typer.Option("--mavlink", help="with --sim: the simulation in its own process, flown over real MAVLink")
    ] = False,
    connect: Connect = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="simulate on the wall clock")] = False,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    places: Annotated[
        list[Path] | None,
        typer.Option("--from", help="directory from which missions and vehicle files may come; default: this one"),
    ] = None,
    runs: Annotated[Path, typer.Option(help="where the records of flights go")] = Path("runs"),
    socket: Annotated[Path | None, typer.Option(help="where to listen, else FLIGHTAPP_SOCKET says it")] = None,
) -> None:
    """Wait for missions on a Unix socket and fly one at a time; SIGTERM lands, then ends it."""
    from flightapp.config import load_config  # noqa: PLC0415  what flying needs, the others do not
    from flightapp.service.daemon import Service, ServiceOptions  # noqa: PLC0415
    from flightapp.service.journal import Journal  # noqa: PLC0415
    from flightapp.service.notify import Notifier  # noqa: PLC0415

    if sim == (connect is not None) or (mavlink and not sim):
        raise BadInputError("say what to fly: --sim, --sim --mavlink or --connect URL")
    rig = "px4" if connect is not None else "mavlink" if mavlink else "sim"
    settings = (*(overrides or ()), *([f"link.connection={connect}"] if connect is not None else []))
    allowed = tuple(place.resolve() for place in places or [Path()])
    if absent := [str(place) for place in allowed if not place.is_dir()]:
        raise BadInputError(f"--from {', '.join(absent)}: there is no such directory")
    load_config(vehicle, None, settings)  # what no start could mend is told at once
    options = ServiceOptions(
        socket or socket_path(), rig, allowed, runs.resolve(), vehicle, settings, realtime or rig != "sim"
    )
    notifier, journal = Notifier(), Journal()
    try:
        Service(options, notifier, journal).run()
    finally:
        journal.close()
        notifier.close()


def start(
    mission: Mission,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything random in a simulation")] = 0,
    wait: Annotated[
        bool, typer.Option("--wait", help="until the flight is over; exit status 0 if it succeeded")
    ] = False,
) -> None:
    """Have the service fly a mission; returns when it is about to take off."""
    chosen = None if vehicle is None else str(vehicle.resolve())
    given = {"mission": str(mission.resolve()), "vehicle": chosen, "settings": tuple(overrides or ()), "seed": seed}
    request = validate(Start, given, "start")
    run = said(request)["run"]
    with console.status(f"{mission.stem}: preparing"):
        ended = _follow(run, wait)
    if ended is None:
        console.print(f"{mission.stem} is flying; its record: {run}", highlight=False, soft_wrap=True)
        return
    why = f"\nit does not count as a success: {ended['failed']}" if ended["failed"] else ""
    console.print(f"{ended['outcome']}: {ended['reason']}{why}\nrecord: {run}", highlight=False, soft_wrap=True)
    raise typer.Exit(1 if ended["failed"] else 0)


def _follow(run: str, wait: bool) -> dict[str, Any] | None:
    """How the flight ``run`` ended; None as soon as it takes off, unless ``wait``."""
    while True:
        told = said(Status())
        flight, last = told["flight"], told["last"]
        if last is not None and last["run"] == run:
            return dict(last)
        if flight is None or flight["run"] != run:
            raise BadInputError(f"the service knows nothing of {run} any more; see `journalctl -u flightapp`")
        if not wait and flight.get("phase", "idle") != "idle":
            return None
        time.sleep(LOOK)


def stop() -> None:
    """Have the flight come to rest along its line and land."""
    console.print(said(Stop())["text"])


def abort() -> None:
    """Have the autopilot land right where the vehicle is, at once; nothing more is sent to steer it."""
    console.print(said(Abort())["text"])


def status(as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False) -> None:
    """What the service does, and how its last flight ended."""
    told = said(Status())
    if as_json:
        del told["ok"]
        print(json.dumps(told, indent=2, ensure_ascii=False))
        return
    flight, last = told["flight"] or {}, told["last"]
    console.print(f"service: {told['state']}{', ' + told['stopping'] if told['stopping'] else ''}", highlight=False)
    for name, value in flight.items():
        console.print(f"  {name:10} {_words(name, value)}", highlight=False, soft_wrap=True)
    if last is not None:
        console.print(f"last flight: {last['mission']}, {last['outcome']}: {last['reason']}", highlight=False)
        console.print(f"  record     {last['run']}", highlight=False, soft_wrap=True)


def _words(name: str, value: Any) -> str:
    if value is None or value == []:
        return "none" if name == "faults" else "–"
    if name == "gates":
        return f"{value[0]} of {value[1]} passed"
    units = {"time": " s", "speed": " m/s", "position": " m"}
    return (", ".join(map(str, value)) if isinstance(value, list) else str(value)) + units.get(name, "")


def said(request: BaseModel) -> dict[str, Any]:
    """What the service answers; what it refuses is told, with exit status 1."""
    answer = ask(request)
    if not answer.get("ok"):
        Console(stderr=True).print(
            f"flightapp: refused: {answer.get('error')}", style="red", highlight=False, markup=False, soft_wrap=True
        )
        raise typer.Exit(1)
    return answer
