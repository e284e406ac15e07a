"""Flies many flights, in processes of this computer or on a cluster, and goes on with what was interrupted."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from flightapp import app
from flightapp.campaign.cluster import work_on_cluster
from flightapp.campaign.pool import Lost, work
from flightapp.campaign.run import Result, Run, failure, fly_run
from flightapp.campaign.store import Store

Advance = Callable[[bool], None]
"""Told of each flight whether it was a success."""


@dataclass(frozen=True, slots=True)
class Where:
    """Where flights are flown, and where their results are kept."""

    workers: int = 2
    """Processes of this computer."""
    scheduler: str | None = None
    """Instead: the address of a Dask cluster's."""
    out: Path | None = None
    """A directory for the results; those that are there already are not flown again."""


def check(runs: Iterable[Run]) -> None:
    """Make sure that all of ``runs`` can begin; raises `BadInputError`."""
    for run in {run.label: run for run in runs}.values():
        app.prepare(run.plan)


def fly_all(runs: Sequence[Run], where: Where, advance: Advance) -> list[Result]:
    """Fly ``runs``, begun in their order; their results in that order. Raises `BadInputError`.

    A flight whose process died each time is a failure; its result is not kept, so that it is tried again.
    """
    check(runs)
    store = Store(where.out, runs) if where.out is not None else None
    texts: dict[int, str] = {}
    for number, run in enumerate(runs):
        if store is not None and (text := store.read(run)) is not None:
            texts[number] = text
            advance(not failure(json.loads(text)))
    missing = [number for number in range(len(runs)) if number not in texts]
    jobs = [runs[number] for number in missing]
    if where.scheduler is not None and jobs:
        answers = work_on_cluster(fly_run, jobs, where.scheduler)
    else:
        answers = work(fly_run, jobs, where.workers)
    lost: dict[int, Result] = {}
    for place, answer in answers:
        number = missing[place]
        if isinstance(answer, Lost):
            lost[number] = runs[number].lost(answer.why)
            advance(False)
            continue
        texts[number] = answer
        if store is not None:
            store.write(runs[number], answer)
        advance(not failure(json.loads(answer)))
    return [lost[n] if n in lost else json.loads(texts[n]) for n in range(len(runs))]
