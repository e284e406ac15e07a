"""Reading and writing PX4's parameters through MAVSDK."""

import asyncio
from typing import TypeVar

from mavsdk.plugins.param import Param, ParamError, ParamResult

from flightapp.interfaces import AutopilotError

V = TypeVar("V", int, float)


class ParameterMissingError(AutopilotError):
    """The autopilot has no parameter of that name."""


class ParameterStore:
    """The vehicle's parameters. Calls go through the loop's default executor, since MAVSDK's block."""

    def __init__(self, plugin: Param) -> None:
        self._plugin = plugin

    async def read(self, name: str) -> int | float:
        """A parameter's value, in the type that it has.

        PX4 doesn't answer for a name that it doesn't know, so a missing one takes as long as a silent link. Raises
        `ParameterMissingError`, `AutopilotError`.
        """
        return await asyncio.to_thread(self._read, name)

    async def read_all(self) -> dict[str, int | float]:
        """Every parameter of the vehicle; empty where the autopilot is silent."""
        everything = await asyncio.to_thread(self._plugin.get_all_params)
        values: dict[str, int | float] = {p.name: p.value for p in everything.int_params or []}
        return values | {p.name: p.value for p in everything.float_params or []}

    async def write(self, name: str, value: int | float) -> None:
        """Set a parameter; an int sets an integer parameter. Raises as `read` does."""
        await asyncio.to_thread(self._write, name, value)

    def _read(self, name: str) -> int | float:
        try:
            try:
                return int(self._plugin.get_param_int(name))
            except ParamError as error:
                if error.result not in (ParamResult.WRONG_TYPE, ParamResult.TYPE_MISMATCH):
                    raise
            return float(self._plugin.get_param_float(name))
        except ParamError as error:
            raise _told("read", name, error) from None

    def _write(self, name: str, value: int | float) -> None:
        try:
            if isinstance(value, int):
                self._plugin.set_param_int(name, value)
            else:
                self._plugin.set_param_float(name, value)
        except ParamError as error:
            raise _told(f"set to {value}", name, error) from None


def _told(what: str, name: str, error: ParamError) -> AutopilotError:
    if error.result in (ParamResult.DOES_NOT_EXIST, ParamResult.TIMEOUT):
        return ParameterMissingError(f"parameter {name} could not be {what}: the autopilot has none, or didn't answer")
    return AutopilotError(f"parameter {name} could not be {what}: {error.result.name.lower().replace('_', ' ')}")
