"""Errors that a user can mend, in words that say what, where and how."""

import difflib
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

M = TypeVar("M", bound=BaseModel)
Location = tuple[str | int, ...]


class BadInputError(Exception):
    """What the user gave cannot be used; the text says what, where and how to mend it."""


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The contents of a TOML file, ``what`` it is in words; raises `BadInputError` that names it."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadInputError(f"{path}: there is no such {what}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise BadInputError(f"{path}: not valid TOML: nested too deeply") from None


def validate(model: type[M], data: dict[str, Any], source: str | Callable[[Location], str]) -> M:
    """``data`` as a ``model``; raises `BadInputError` naming source, key, value, bound and nearest known key.

    ``source`` says where the data came from, or tells it for the location of one key.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = []
        for problem in error.errors():
            where = source if isinstance(source, str) else source(problem["loc"])
            lines.append(f"{where}: {_describe(model, dict(problem))}")
        raise BadInputError("; ".join(lines)) from None


def _describe(model: type[BaseModel], problem: dict[str, Any]) -> str:
    location: Location = problem["loc"]
    key = ".".join(str(part) for part in location if not _is_kind(part))
    if problem["type"] == "extra_forbidden":
        known = _fields(model, location[:-1])
        return f"unknown key '{key}'{_nearest(str(location[-1]), known)}"
    if problem["type"] == "missing":
        return f"'{key}' is missing"
    message = problem["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if not key or isinstance(problem["input"], dict):
        return f"{key}: {message}" if key else message
    return f"'{key}' = {problem['input']!r}: {message}"


def _nearest(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; known here: {', '.join(known)}" if known else ""


def _is_kind(part: str | int) -> bool:
    """Whether a location's part is not a key but tells, as "(name)", which of several models was meant there."""
    return isinstance(part, str) and part.startswith("(")


def _fields(model: type[BaseModel], path: Location) -> list[str]:
    models = [model]
    for part in path:
        if isinstance(part, int):
            continue
        if _is_kind(part):
            models = [m for m in models if m.__name__.lower() == part.strip("()")]
        else:
            field = models[0].model_fields.get(part) if models else None
            models = _models(field.annotation) if field else []
    return list(models[0].model_fields) if models else []


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]
