"""What goes over the control socket: a request as one line of JSON, and the answer as another.

A connection carries one request. The answer has "ok"; where that is false, "error" says what is wrong and how to mend
it. Requests are checked strictly: a key, a type or a length that is not as stated here is refused.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from flightapp.inputs import BadInputError

LINE = 16384
"""Bytes that a request may have, its newline included."""
TOLD = 3
"""Things wrong with a request that are told."""

Name = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
Text = Annotated[str, StringConstraints(min_length=1, max_length=1024)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Start(_Request):
    """Fly a mission."""

    do: Literal["start"] = "start"
    mission: Name
    """Absolute path."""
    vehicle: Name | None = None
    settings: tuple[Text, ...] = Field((), max_length=64)
    """Each "section.key=value"."""
    seed: int = Field(0, ge=0, lt=2**32)


class Stop(_Request):
    """Come to rest along the line and land."""

    do: Literal["stop"] = "stop"


class Abort(_Request):
    """Land right here."""

    do: Literal["abort"] = "abort"


class Status(_Request):
    """What the service does."""

    do: Literal["status"] = "status"


class Tune(_Request):
    """Go on with other values."""

    do: Literal["tune"] = "tune"
    settings: dict[Text, Text] = Field(min_length=1, max_length=64)
    """Value by "section.key"."""


class Reload(_Request):
    """Go on with what the files say now."""

    do: Literal["reload"] = "reload"


class Tunables(_Request):
    """What may be changed in flight."""

    do: Literal["tunables"] = "tunables"


Request = Start | Stop | Abort | Status | Tune | Reload | Tunables
_REQUESTS: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def parse(line: bytes) -> Request:
    """The request in ``line``; raises `BadInputError`."""
    if len(line) > LINE:
        raise BadInputError(f"the request is longer than {LINE} bytes")
    try:
        return _REQUESTS.validate_json(line)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        told = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}".removeprefix(": ")[:200] for one in found[:TOLD]]
        more = f"; and {len(found) - TOLD} more" if len(found) > TOLD else ""
        raise BadInputError(f"not a request: {'; '.join(told)}{more}") from None


def encode(message: BaseModel | dict[str, Any]) -> bytes:
    """``message`` as a line."""
    text = message.model_dump_json() if isinstance(message, BaseModel) else json.dumps(message, ensure_ascii=False)
    return text.encode("utf-8", "replace") + b"\n"


def refused(why: str) -> dict[str, Any]:
    """The answer to what is not done."""
    return {"ok": False, "error": why}
