"""The command line. A command's module is imported when it is asked for: what it needs is not what flying needs."""

import sys
from importlib import import_module
from typing import Any

import cv2
import typer
from rich.console import Console
from typer.core import TyperGroup

from flightapp.inputs import BadInputError

COMMANDS = {
    "fly": "fly:fly",
    "serve": "service:serve",
    "start": "service:start",
    "stop": "service:stop",
    "abort": "service:abort",
    "status": "service:status",
    "sweep": "sweep:sweep",
    "compare": "compare:compare",
    "paper": "paper:paper",
    "report": "report:report",
    "metrics": "logs:metrics",
    "export": "logs:export",
    "check": "check:check",
    "identify": "identify:identify",
    "tune": "tune:tune",
    "bench": "bench:bench",
    "plan": "plan:plan",
    "doctor": "doctor:doctor",
    "sim-autopilot": "sim_autopilot:sim_autopilot",
    "calibrate": "calibrate:calibrate",
    "markers": "markers:markers",
    "faults": "faults:faults",
}
"""Each command's module in `flightapp.commands` and its function there, or its group of commands, in help's order."""


class Commands(TyperGroup):
    """The group of all commands, each imported at its first use."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands: Any = dict.fromkeys(COMMANDS)  # what is suggested for a name that is none

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command ``cmd_name``; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name].partition(":")
        found = getattr(import_module(f"flightapp.commands.{module}"), name)
        if not isinstance(found, typer.Typer):
            alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
            alone.command(cmd_name)(found)
            found = alone
        command = typer.main.get_command(found)
        command.name = cmd_name
        return command


cli = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Autonomous drone racing on board.",
)


@cli.callback()
def group() -> None:
    """Autonomous drone racing on board."""


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
