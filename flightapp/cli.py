"""The command line: parse, call one function, print."""

import sys
from collections.abc import Sequence
from datetime import date
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import cv2
import typer
from rich.console import Console

from flightapp import app, control_bench, display, identify_command, plan_command, results, tune_command
from flightapp.autopilot.diagnosis import Light, diagnosis_json, diagnosis_tables
from flightapp.autopilot.doctor import Change, Confirm, visit
from flightapp.autopilot.link import Px4Link
from flightapp.autopilot.params_file import write_params
from flightapp.autopilot.wanted_parameters import Profile, wanted_parameters
from flightapp.bench import bench_table, run_bench
from flightapp.calibrate_commands import calibrate
from flightapp.config import dump_config, load_config
from flightapp.control_bench import control_tables, run_control_bench
from flightapp.evaluation.detection_bench import detection_table, run_detection_bench
from flightapp.evaluation.false_ids import FIRST_SEED, false_ids_line, run_false_ids
from flightapp.evaluation.growth import growth_page, growth_tables, measure_growth
from flightapp.evaluation.plan_table import plan_rows, rows_json, rows_table
from flightapp.evaluation.planned import plan_json, plan_tables
from flightapp.evaluation.summary import why_failed
from flightapp.evaluation.tables import rich_table, terminal_tables
from flightapp.fault_cli import faults
from flightapp.inputs import BadInputError
from flightapp.interfaces import PlanningError
from flightapp.mission.loader import load_mission
from flightapp.modules import find
from flightapp.track import load_track

cli = typer.Typer(
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help="Autonomous drone racing on board."
)
cli.add_typer(calibrate, name="calibrate")
cli.command()(faults)
console = Console()

Mission = Annotated[Path, typer.Argument(help="a mission, such as missions/five_gates.py")]
Vehicle = Annotated[Path | None, typer.Option("--vehicle", help="vehicle file, such as config/sim_racer.toml")]
Overrides = Annotated[list[str] | None, typer.Option("--set", help="section.key=value, over all files")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="also write the result here")]
Sim = Annotated[bool, typer.Option("--sim", help="fly the in-process simulation")]
Connect = Annotated[
    str | None, typer.Option("--connect", help="fly a real vehicle at udpin://HOST:PORT or serial:///dev/NAME:BAUD")
]


class Vision(StrEnum):
    """Who feeds the simulated vehicle's own estimator."""

    INTERNAL = "internal"
    EXTERNAL = "external"


@cli.command()
def fly(
    mission: Mission,
    sim: Sim = False,
    mavlink: Annotated[
        bool, typer.Option("--mavlink", help="with --sim: the simulation in its own process, flown over real MAVLink")
    ] = False,
    connect: Connect = None,
    vehicle: Vehicle = None,
    seed: Annotated[int, typer.Option(min=0, help="of everything random in the simulation")] = 0,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="run directory; default: a new one in runs/")] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="simulate on the wall clock")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="list what the mission would do if all went well, without flying")
    ] = False,
) -> None:
    """Fly a mission; exit status 0 only if it reached its goal."""
    if dry_run:
        steps, result = app.dry_run(app.FlightPlan(mission, Path(), vehicle=vehicle, overrides=tuple(overrides or ())))
        console.print(display.rehearsal_table(steps))
        console.print(f"{result.outcome}: {result.reason}; nothing was flown", highlight=False)
        raise typer.Exit(0 if result.achieved else 1)
    if sim == (connect is not None) or (mavlink and not sim):
        raise BadInputError(
            "say what to fly: --sim for the simulation in this process, --sim --mavlink for one behind MAVLink,"
            " --connect URL for a real vehicle"
        )
    rig = "px4" if connect is not None else "mavlink" if mavlink else "sim"
    settings = [*(overrides or ()), *([f"link.connection={connect}"] if connect is not None else [])]
    directory = results.run_directory(mission, seed, out)
    plan = app.FlightPlan(mission, directory, rig, vehicle, tuple(settings), seed, realtime or rig != "sim")
    with display.progress(console) as watch:
        flown = app.fly(plan, watch)
    summary = results.finish(flown)
    console.print(*terminal_tables(summary), sep="\n")
    speed = flown.duration / flown.wall
    console.print(f"{flown.duration:.1f} s flown in {flown.wall:.1f} s ({speed:.1f} × real time)", highlight=False)
    console.print(f"{flown.ending.outcome}: {flown.ending.reason}", highlight=False)
    if flown.log_error:
        console.print(f"the log is not complete: {flown.log_error}", style="red", highlight=False)
    console.print(f"report: {plan.out / 'report.html'}", soft_wrap=True)
    raise typer.Exit(1 if why_failed(summary) else 0)


@cli.command()
def sweep(
    mission: Mission,
    runs: Annotated[int, typer.Option(min=1, help="how many flights")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 2,
    json_file: JsonFile = None,
) -> None:
    """Fly a mission with many seeds in simulation; success rate with its 95 % interval."""
    plan = app.FlightPlan(mission, Path(), "sim", vehicle, tuple(overrides or ()), first_seed)
    app.prepare(plan)
    with display.bar(console, runs) as advance:
        summary = results.sweep(plan, runs, workers, advance)
    console.print(results.sweep_table(summary))
    results.write_json(json_file, summary)


@cli.command()
def report(
    runs: Annotated[list[Path], typer.Argument(help="run directories or flight.mcap files")],
) -> None:
    """Print each flight's tables and write report.html beside its log."""
    for run in runs:
        summary, page = results.report(run)
        console.print(*terminal_tables(summary), sep="\n")
        console.print(f"report: {page}", soft_wrap=True)


@cli.command()
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


@cli.command()
def identify(
    runs: Annotated[list[Path], typer.Argument(help="run directories or flight.mcap files of missions/identify.py")],
    vehicle: Annotated[
        Path | None, typer.Option("--vehicle", help="file to begin from; default: what the first flight flew with")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write")] = None,
    json_file: JsonFile = None,
) -> None:
    """Find the vehicle's parameters in flight logs: thrust, lags, delay, drag."""
    found = identify_command.identify_runs(runs, vehicle)
    console.print(identify_command.findings_table(found))
    results.write_json(json_file, identify_command.findings_json(found))
    if out is not None:
        names = ", ".join(run.name for run in runs)
        identify_command.write_vehicle(out, identify_command.vehicle_text(found, vehicle, names, date.today()))


@cli.command()
def tune(
    vehicle: Annotated[Path, typer.Argument(help="vehicle file, such as config/sim_racer.toml")],
    mission: Annotated[Path, typer.Option(help="whose track is flown")] = Path("missions/lemniscate.py"),
    runs: Annotated[int, typer.Option(min=1, help="how many vehicles are drawn")] = 50,
    first_seed: Annotated[int, typer.Option(min=0, help="seed of the first; the others count up")] = 0,
    search: Annotated[int, typer.Option(min=0, help="seek better gains, trying about so many sets")] = 0,
    overrides: Overrides = None,
    out: Annotated[Path | None, typer.Option(help="vehicle file to write, with the gains that were found")] = None,
    json_file: JsonFile = None,
) -> None:
    """Score a vehicle file over simulated vehicles that are not quite what it says; exit status 1 if one is lost."""
    if out is not None and search == 0:
        raise BadInputError("--out takes the gains that --search N finds; give both")
    options = tune_command.TuneOptions(vehicle, mission, runs, first_seed, tuple(overrides or ()), search)
    with console.status("flying"):
        tuned = tune_command.tune(options)
    console.print(*tune_command.tuned_tables(tuned), sep="\n")
    results.write_json(json_file, tune_command.tuned_json(tuned))
    if search and not tuned.improved:
        console.print("nothing better was found", highlight=False)
    elif out is not None:
        tune_command.write_gains(tuned, out)
        console.print(f"written: {out}", highlight=False, soft_wrap=True)
    raise typer.Exit(1 if tuned.score.crashes else 0)


@cli.command()
def bench(
    detection: Annotated[
        bool, typer.Option("--detection", help="marker detectors side by side: time, share found, corner error")
    ] = False,
    false_ids: Annotated[
        int | None, typer.Option("--false-ids", min=1, help="counts markers seen in so many pictures without any")
    ] = None,
    first_seed: Annotated[
        int | None, typer.Option(min=0, help="of the pictures of --false-ids, of the vehicles of --control")
    ] = None,
    control: Annotated[
        bool, typer.Option("--control", help="controllers side by side: tracking errors of vehicle and control alone")
    ] = False,
    vehicle: Vehicle = None,
    runs: Annotated[int, typer.Option(min=1, help="with --control: perturbed vehicles on each course")] = 20,
    growth: Annotated[
        Path | None, typer.Option(help="FILE.html: a page on how planning time grows with the number of points")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Computation times on this computer, beside the paper's."""
    if false_ids is not None:
        for counted in run_false_ids(false_ids, FIRST_SEED if first_seed is None else first_seed):
            console.print(false_ids_line(counted), highlight=False)
            results.write_json(json_file, counted)
        raise typer.Exit(1 if counted["false"] else 0)
    if control:
        seed = control_bench.FIRST_SEED if first_seed is None else first_seed
        compared = run_control_bench(vehicle=vehicle, runs=runs, first_seed=seed)
        console.print(*map(rich_table, control_tables(compared)), sep="\n")
        results.write_json(json_file, compared)
        return
    if growth is not None:
        measured = tuple(measure_growth())
        results.write_text(growth, growth_page(measured), "--growth")
        console.print(*(rich_table(table) for table in growth_tables(measured)), sep="\n")
        return
    result = run_detection_bench() if detection else run_bench()
    console.print(detection_table(result) if detection else bench_table(result))
    results.write_json(json_file, result)


@cli.command()
def plan(
    track: Annotated[Path | None, typer.Argument(help="a track, such as missions/tracks/five_gates.toml")] = None,
    planner: Annotated[
        str | None, typer.Option(help="instead of planning.planner; with --table several, as race,polynomial")
    ] = None,
    v_max: Annotated[float | None, typer.Option("--v-max", help="m/s, or inf, instead of race.v_max")] = None,
    a_max: Annotated[float | None, typer.Option("--a-max", help="m/s², or inf, instead of race.a_max")] = None,
    laps: Annotated[int | None, typer.Option(min=1, help="instead of mission.laps")] = None,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    out: Annotated[
        list[Path] | None, typer.Option(help="FILE.csv, FILE.mcap or FILE.html; may be given several times")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Hz, of samples in FILE.csv; default: its polynomials")] = None,
    table: Annotated[bool, typer.Option("--table", help="all yardstick courses beside the least times")] = False,
    json_file: JsonFile = None,
) -> None:
    """Plan without flying, and draw the line; exit status 1 if there is no plan that could be flown."""
    if table:
        _plan_table(planner or "race,polynomial", json_file)
        return
    if track is None:
        raise BadInputError("plan: name a track, such as missions/tracks/five_gates.toml, or give --table")
    plan_command.check_outputs(out or (), rate)
    options = plan_command.PlanOptions(track, planner, v_max, a_max, laps, vehicle, tuple(overrides or ()))
    try:
        planned = plan_command.plan_track(options)
    except PlanningError as error:
        Console(stderr=True).print(f"no plan: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    console.print(*map(rich_table, plan_tables(planned)), sep="\n")
    page = Path("runs") / f"plan-{track.stem}.html"
    for path in plan_command.write_plan(planned, out or (), rate, page):
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    results.write_json(json_file, plan_json(planned))
    if touch := plan_command.touch_of(planned):
        console.print(f"not to be flown: {touch}", style="red", highlight=False, markup=False)
        raise typer.Exit(1)


def _plan_table(planners: str, json_file: Path | None) -> None:
    with console.status("planning"):
        rows = list(plan_rows(planners.split(",")))
    console.print(rich_table(rows_table(rows)))
    for row in rows:
        if row.why:
            console.print(f"{row.course}, {row.v_max:g} m/s, {row.planner}: {row.why}", markup=False)
    results.write_json(json_file, rows_json(rows))


@cli.command()
def doctor(
    connect: Annotated[
        str | None, typer.Option("--connect", help="udpin://HOST:PORT or serial:///dev/NAME:BAUD")
    ] = None,
    vehicle: Vehicle = None,
    overrides: Overrides = None,
    profile: Annotated[
        Profile, typer.Option(help="cage: no remote control, no ground station; pilot: a safety pilot's is on")
    ] = Profile.CAGE,
    fix: Annotated[bool, typer.Option("--fix", help="set the parameters that differ, after listing them")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="with --fix: don't ask")] = False,
    params: Annotated[
        Path | None, typer.Option("--params", help="only write the wanted parameters here, for QGroundControl")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Examine the vehicle before it flies; exit status 0 only if nothing is red."""
    settings = [*(overrides or ()), *([f"link.connection={connect}"] if connect is not None else [])]
    config = load_config(vehicle, None, settings)
    if params is not None:
        write_params(params, wanted_parameters(config, profile), profile)
        return
    if yes and not fix:
        raise BadInputError("--yes answers what --fix asks; give both, or neither to examine only")
    confirm = _confirm(yes) if fix else None
    diagnosis = visit(Px4Link, config, profile, confirm, Path("runs"))
    console.print(*diagnosis_tables(diagnosis), sep="\n")
    results.write_json(json_file, diagnosis_json(diagnosis))
    raise typer.Exit(1 if diagnosis.light is Light.RED else 0)


@cli.command("sim-autopilot")
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


def _confirm(yes: bool) -> Confirm:
    def confirm(todo: Sequence[Change]) -> bool:
        console.print(f"{len(todo)} parameters to be written:", *(f"  {change.text}" for change in todo), sep="\n")
        return yes or typer.confirm("write them?")

    return confirm


def main() -> None:
    """Run a command; what the user can mend is one paragraph on stderr and exit status 2."""
    cv2.setNumThreads(1)  # its threads would compete with the tasks for the cores
    try:
        cli()
    except BadInputError as error:
        Console(stderr=True).print(f"flightapp: {error}", style="red", highlight=False, markup=False, soft_wrap=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
