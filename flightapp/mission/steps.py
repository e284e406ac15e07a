"""Missions that are a list of steps, in TOML: each a behavior, with its parameters and what to do where it fails."""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from flightapp.inputs import BadInputError, read_toml, validate
from flightapp.mission.drone import Drone
from flightapp.modules import find

OWN = {"do", "on_failure", "repeat"}
"""Keys of a step that are not the behavior's."""


class Step(BaseModel):
    """One behavior; all keys but its own are the behavior's parameters."""

    model_config = ConfigDict(extra="allow", frozen=True)

    do: str = Field(description="name of a behavior")
    on_failure: Literal["land", "continue"] = Field("land", description="what follows where it isn't achieved")
    repeat: int = Field(1, ge=1, le=1000, description="times")

    @property
    def parameters(self) -> dict[str, Any]:
        """The behavior's."""
        return {key: _frozen(value) for key, value in (self.model_extra or {}).items()}


class Steps(BaseModel):
    """A whole file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    track: str = Field(description="the track's file, relative to the mission's")
    settings: dict[str, Any] = Field(default_factory=dict, description="tables as in a vehicle file")
    steps: tuple[Step, ...] = Field(min_length=1)

    def flat_settings(self) -> dict[str, Any]:
        """The settings by dotted keys, as a mission in Python gives them."""
        return dict(_flat(self.settings))

    async def run(self, drone: Drone) -> None:
        """Do one step after the other."""
        for step in self.steps:
            for _ in range(step.repeat):
                await drone.run(step.do, check=step.on_failure == "land", **step.parameters)


def read_steps(path: Path) -> Steps:
    """Read and check a mission of steps; raises `BadInputError` that names the step and what is wrong with it."""
    steps = validate(Steps, read_toml(path, "mission file"), str(path))
    for number, step in enumerate(steps.steps, start=1):
        try:
            behavior = find("behaviors", step.do)
            validate(behavior.accepts, step.parameters, f"behavior {step.do}")
        except BadInputError as error:
            raise BadInputError(f"{path}: step {number}: {error}") from None
    return steps


def _flat(table: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    flat: list[tuple[str, Any]] = []
    for key, value in table.items():
        flat += _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(f"{prefix}{key}", value)]
    return flat


def _frozen(value: Any) -> Any:
    """``value`` with tuples for lists, so that two activations can be compared."""
    return tuple(_frozen(part) for part in value) if isinstance(value, list) else value
