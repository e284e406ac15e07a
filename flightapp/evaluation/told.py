"""What the metrics need of the configuration that a flight was flown with."""

from pydantic import BaseModel, ConfigDict, Field

IGNORE = ConfigDict(extra="ignore", frozen=True)


class _Race(BaseModel):
    model_config = IGNORE

    v_max: float | None = None


class _Mission(BaseModel):
    model_config = IGNORE

    laps: int = Field(1, ge=1, le=1000)


class _Control(BaseModel):
    model_config = IGNORE

    rate: float | None = Field(None, gt=0.0, le=1e6)


class _Vehicle(BaseModel):
    model_config = IGNORE

    thrust_to_weight: float | None = Field(None, gt=0.0)
    rate_max: float | None = Field(None, gt=0.0)
    yaw_rate_max: float | None = Field(None, gt=0.0)


class _Guard(BaseModel):
    model_config = IGNORE

    thrust_min: float | None = Field(None, ge=0.0)


class Told(BaseModel):
    """As much of it as is used here: logs of older versions have other fields, and some tools write none."""

    model_config = IGNORE

    race: _Race = _Race()
    mission: _Mission = _Mission()
    control: _Control = _Control()
    vehicle: _Vehicle = _Vehicle()
    guard: _Guard = _Guard()
