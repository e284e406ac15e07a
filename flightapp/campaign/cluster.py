"""Work on a Dask cluster."""

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TypeVar

from flightapp.campaign.pool import Lost
from flightapp.inputs import BadInputError

J = TypeVar("J")
R = TypeVar("R")

PATIENCE = "10s"
"""For the scheduler's answer."""
_alone = threading.Lock()


def work_on_cluster(function: Callable[[J], R], jobs: Sequence[J], address: str) -> Iterator[tuple[int, R | Lost]]:
    """As `pool.work`, on the cluster whose scheduler is at ``address`` (tcp://HOST:PORT); raises `BadInputError`.

    Its workers need the same program and, at the same paths, the same files. Dask itself tries again what a worker
    that died was at, as often as its scheduler's setting `allowed-failures` says.
    """
    try:
        distributed = import_module("distributed")
    except ImportError:
        raise BadInputError("--scheduler needs Dask, which is not installed: pip install flightapp[dask]") from None
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInputError(f"--scheduler {address}: no Dask scheduler answers there: {error}") from None
    with client:
        futures = client.map(partial(_do, function, Path.cwd()), jobs, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        for future in distributed.as_completed(futures, loop=client.loop):
            try:
                yield numbers[future.key], future.result()
            except distributed.KilledWorker as error:
                yield numbers[future.key], Lost(f"its worker died, {error.allowed_failures + 1} times")
            future.release()


def _do(function: Callable[[J], R], directory: Path, job: J) -> R:
    """``function`` of ``job`` in ``directory``; a worker with several threads does not fly in all of them at once."""
    with _alone, contextlib.chdir(directory):
        return function(job)
