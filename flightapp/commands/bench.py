"""The command `flightapp bench`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from flightapp import control_bench, results
from flightapp.bench import bench_table, run_bench
from flightapp.commands.options import JsonFile, Vehicle
from flightapp.control_bench import control_tables, run_control_bench
from flightapp.evaluation.detection_bench import detection_table, run_detection_bench
from flightapp.evaluation.false_ids import FIRST_SEED, false_ids_line, run_false_ids
from flightapp.evaluation.growth import growth_page, growth_tables, measure_growth
from flightapp.evaluation.tables import rich_table

console = Console()


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
