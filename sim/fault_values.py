"""What a fault's value may be: a number, a share, a time, a switch, names."""

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from flightapp.inputs import BadInputError
from sim.px4.modes import NavState

Value = float | str | bool | Sequence[str] | None


def number(value: Value) -> float:
    """A finite number; raises ValueError."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{value!r} is not a number")
    try:
        read = float(value)
    except ValueError:
        raise ValueError(f"'{value}' is not a number") from None
    if not math.isfinite(read):
        raise ValueError(f"{read} is not finite")
    return read


def share(value: Value) -> float:
    """0 to 1; raises ValueError."""
    read = number(value)
    if not 0.0 <= read <= 1.0:
        raise ValueError(f"a share is 0 to 1, not {read:g}")
    return read


def seconds(value: Value) -> float:
    """0 or more; raises ValueError."""
    read = number(value)
    if read < 0.0:
        raise ValueError(f"a time is 0 s or more, not {read:g}")
    return read


def switch(value: Value) -> bool:
    """None is on: to name a fault is enough."""
    return True if value is None else value if isinstance(value, bool) else bool(number(value))


def names(value: Value) -> frozenset[str]:
    """Names, or one text with commas between them; raises ValueError."""
    given = value.split(",") if isinstance(value, str) else value if isinstance(value, Sequence) else None
    if given is None:
        raise ValueError("give the names of parameters")
    return frozenset(name.strip() for name in given if name.strip())


def pair(value: Value) -> tuple[float, float]:
    """Two numbers with a colon between them; raises ValueError."""
    parts = value.split(":") if isinstance(value, str) else ()
    if len(parts) != 2:
        raise ValueError(f"give two numbers with a colon between them, not {value!r}")
    return number(parts[0]), number(parts[1])


def numbers(value: Value, count: int) -> tuple[float, ...]:
    """``count`` numbers with colons between them; raises ValueError."""
    parts = value.split(":") if isinstance(value, str) else ()
    if len(parts) != count:
        raise ValueError(f"give {count} numbers with colons between them, not {value!r}")
    return tuple(number(part) for part in parts)


def nav_state(value: Value) -> NavState:
    """A flight mode by its name or label; raises ValueError."""
    states = {state.label.upper(): state for state in NavState} | {state.name: state for state in NavState}
    state = states.get(str(value).upper())
    if state is None:
        raise ValueError(f"'{value}' is no flight mode; there are {', '.join(s.label for s in NavState)}")
    return state


def unknown(name: str, known: Iterable[str]) -> BadInputError:
    """The error for a fault that there is not."""
    there = tuple(known)
    near = get_close_matches(name, there, 1)
    hint = f"; did you mean '{near[0]}'?" if near else f"; there are {', '.join(there)}"
    return BadInputError(f"unknown fault '{name}'{hint}")
