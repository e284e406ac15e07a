"""What all sections share."""

from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Quadruple = tuple[Finite, Finite, Finite, Finite]
_SIGNS = {Gt: ">", Ge: "≥", Lt: "<", Le: "≤"}


class Section(BaseModel):
    """A table of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
    FIXED_IN_FLIGHT: ClassVar[frozenset[str] | None] = None
    """Fields that must not change in flight, where the others may; None where none may."""

    @classmethod
    def may_change_in_flight(cls, key: str) -> bool:
        """Whether the field ``key`` may."""
        return cls.FIXED_IN_FLIGHT is not None and key not in cls.FIXED_IN_FLIGHT


def bounds(field: FieldInfo) -> str:
    """Those of ``field``'s values, such as "> 0.1, ≤ 20"; empty where there are none."""
    signs = [
        f"{sign} {getattr(bound, kind.__name__.lower()):g}"
        for kind, sign in _SIGNS.items()
        for bound in field.metadata
        if isinstance(bound, kind)
    ]
    return ", ".join(signs)
