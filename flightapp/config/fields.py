"""What all sections share."""

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Quadruple = tuple[Finite, Finite, Finite, Finite]


class Section(BaseModel):
    """A table of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
    FIXED_IN_FLIGHT: ClassVar[frozenset[str] | None] = None
    """Fields that must not change in flight, where the others may; None where none may."""
