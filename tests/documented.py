"""What README and documentation tell the reader to type, and how it is tried without a vehicle and in a minute."""

import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import typer

from flightapp import cli
from flightapp.config import load_config
from flightapp.inputs import BadInputError

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "CONTRIBUTING.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md")))
BLOCK = re.compile(r"(?:<!-- parsed: ([^>]*) -->\n)?^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"^`([\w./-]+\.(?:toml|py))`[^\n]*(?:\n[^\n]+)*\n\n\Z", re.MULTILINE)
"""The paragraph before a file's text, which begins with the file's name."""
LANGUAGES = {"sh", "python", "toml", "text"}
REASONS = {
    "environment": "it makes or changes the environment that the tests run in",
    "hardware": "it needs a vehicle, or a tracker",
    "two terminals": "the first runs until the second has flown over MAVLink; tests/closed_loop does the same",
    "wall clock": "it takes as long as it flies; tests/closed_loop does the same",
    "other recordings": "it reads recordings that are not in the repository; tests/interchange makes some",
    "a vehicle file of yours": "it takes the reader's own file",
    "test suite": "it runs this suite",
}
"""Why the commands of a block are only looked at: these marks stand before it."""
LONG = {
    "bench": "minutes; tests/test_controllers_compared.py and tests/evaluation",
    "compare": "tests/campaign/test_compare_command.py, and the tutorial's, with one flight a module",
    "faults": "hours; tests/closed_loop/test_fault_table.py",
    "identify": "it needs an identification flight; tests/test_identify_command.py",
    "paper": "minutes; tests/campaign/test_paper_command.py",
    "sweep": "tests/campaign and tests/evaluation/test_sweep.py",
    "tune": "minutes; tests/tuning",
}
"""Commands that are only looked at everywhere, and where they are run."""
PROGRAMS = {"apt", "sudo", "make", "pip", "pre-commit", ".", "python", "python3", ".venv/bin/python", "flightapp"}


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: str
    language: str
    text: str
    parsed: str
    """Why its commands are only looked at; empty where they are run."""
    file: str
    """The name of the file that it is; empty for none."""

    def commands(self):
        """Each command as words, comments left out."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [words for line in lines if (words := shlex.split(line, comments=True))]


def blocks(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    found = []
    for match in BLOCK.finditer(text):
        named = match[2] in ("python", "toml") and NAMED.search(text, 0, match.start())
        found.append(Block(page, match[2], match[3], match[1] or "", named[1] if named else ""))
    return found


def look_at(words):
    """Raise unless ``words`` is a command that exists, with options that it has and files of ours that exist."""
    program = words[0]
    assert program in PROGRAMS, f"{program}: no program that the documentation may ask for"
    for word in words[1:]:
        if re.match(r"(missions|config|tests|flightapp)/.*\.(py|toml|params)$", word) and word not in TO_WRITE:
            assert (ROOT / word).exists(), f"{word}: there is no such file"
    if program == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        assert words[1] in targets, f"make {words[1]}: there is no such target"
    if program == "flightapp":
        _parse(words[1:])


TO_WRITE = {"missions/hover.toml", "missions/turns.py"}
"""Files that a page has the reader write among ours."""


def _parse(words):
    command = typer.main.get_command(cli.cli)
    name, rest = "flightapp", words
    while hasattr(command, "list_commands"):
        name, rest = rest[0], rest[1:]
        found = command.get_command(None, name)
        assert found is not None, f"flightapp {name}: there is no such command"
        command = found
    parameters = command.make_context(name, list(rest)).params
    settings = parameters.get("overrides") or []
    grid = [f"{key}={values.partition(',')[0]}" for key, _, values in map(split_grid, parameters.get("grid") or [])]
    load_config(None, None, [*settings, *grid])


def split_grid(text):
    return text.partition("=")


def run(words, monkeypatch, capsys):
    """Run a command in this process; exit status, standard output and error."""
    monkeypatch.setattr(sys, "argv", ["flightapp", *words])
    status = 0
    try:
        cli.main()
    except SystemExit as ended:
        status = ended.code or 0
    except BadInputError as error:
        return 2, "", str(error)
    return status, *capsys.readouterr()
