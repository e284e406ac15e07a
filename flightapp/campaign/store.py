"""A directory of results: each is written as its flight ends, so that what was interrupted can be gone on with."""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import flightapp
from flightapp import app
from flightapp.campaign.run import Run
from flightapp.config import dump_config
from flightapp.inputs import BadInputError

PLAN = "plan.json"
RESULTS = "results"


class Store:
    """Results of flights in ``directory``, which belongs to one plan.

    A plan is the program and, for each label, the mission, its track and the effective configuration; seeds may be
    added. Raises `BadInputError` where the directory holds another plan's results or cannot be used.
    """

    def __init__(self, directory: Path, runs: Iterable[Run]) -> None:
        self._results = directory / RESULTS
        flown = {label: run_print(run) for label, run in {run.label: run for run in runs}.items()}
        try:
            self._results.mkdir(parents=True, exist_ok=True)
            _check(directory, program_print(), flown)
        except OSError as error:
            raise BadInputError(f"--out {directory}: cannot be used: {error.strerror or error}") from None

    def read(self, run: Run) -> str | None:
        """The result of ``run`` as it was written; None if there is none that is whole."""
        try:
            text = self._path(run).read_text(encoding="utf-8")
            json.loads(text)
        except (OSError, ValueError):
            return None
        return text

    def write(self, run: Run, text: str) -> None:
        """Keep the result of ``run``, whole or not at all."""
        write_whole(self._path(run), text)

    def _path(self, run: Run) -> Path:
        name = re.sub(r"[^\w.=+-]+", "_", run.label)[:80]
        return self._results / f"{name}-{_print(run.label)[:6]}-{run.plan.seed:06d}.json"


def write_whole(path: Path, text: str) -> None:
    """Write ``text`` to ``path``, whole or not at all."""
    scratch = path.with_suffix(".tmp")
    scratch.write_text(text, encoding="utf-8")
    scratch.replace(path)


def program_print() -> str:
    """A fingerprint of the program: two that are not the same need not fly alike."""
    package = Path(flightapp.__file__).parent
    digest = hashlib.sha256()
    for root in (package, package.parent / "sim"):
        for path in sorted(path for path in root.rglob("*") if path.suffix in {".py", ".toml"}):
            digest.update(path.relative_to(package.parent).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def run_print(run: Run) -> str:
    """A fingerprint of what ``run`` flies, whatever its seed; raises `BadInputError` where that cannot be flown."""
    mission, config = app.prepare(run.plan)
    text = run.plan.mission.read_text(encoding="utf-8")
    return _print("\n".join((text, mission.track.model_dump_json(), dump_config(config))))


def _print(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _check(directory: Path, program: str, flown: Mapping[str, str]) -> None:
    """Begin a new plan in ``directory``, or make sure that it is the one that is there."""
    path = directory / PLAN
    if not path.exists():
        if any((directory / RESULTS).iterdir()):
            raise BadInputError(f"--out {directory}: holds results but no {PLAN}; choose another directory")
        write_whole(path, json.dumps({"program": program, "flown": flown}, indent=2, ensure_ascii=False) + "\n")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        there, made_by = dict(before["flown"]), str(before["program"])
    except (ValueError, KeyError, TypeError):
        raise BadInputError(f"{path}: cannot be read; choose another directory") from None
    if why := _difference(there, flown) or ("the program is another one" if made_by != program else ""):
        raise BadInputError(f"--out {directory}: holds another plan's flights: {why}; choose another directory")


def _difference(there: Mapping[str, str], asked: Mapping[str, str]) -> str:
    """What is not the same, in words; empty where all is."""
    if there.keys() != asked.keys():
        return f"{', '.join(there)} there, {', '.join(asked)} now"
    changed = [label for label in asked if there[label] != asked[label]]
    return f"mission, track or settings of {', '.join(changed)} are not the same" if changed else ""
