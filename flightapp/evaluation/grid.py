"""Parameter grids: every combination of the values of some settings."""

import itertools
from collections.abc import Sequence

from flightapp.inputs import BadInputError

Grid = Sequence[tuple[str, tuple[str, ...]]]
"""Settings with the values that each takes."""
Combination = tuple[tuple[str, str], ...]
"""One value of each."""


def read_grid(texts: Sequence[str]) -> Grid:
    """The grid of "section.key=value,value…" strings, as the command line has them; raises `BadInputError`.

    Commas inside brackets and quotes belong to a value.
    """
    grid: list[tuple[str, tuple[str, ...]]] = []
    for text in texts:
        key, separator, listed = text.partition("=")
        values = tuple(value.strip() for value in split(listed))
        if not separator or not key.strip() or not all(values):
            raise BadInputError(f"--grid {text}: expected section.key=value,value…, as race.v_max=2,4,6")
        if key.strip() in dict(grid):
            raise BadInputError(f"--grid {text}: {key.strip()} is given twice; list all its values in one --grid")
        if len(set(values)) < len(values):
            raise BadInputError(f"--grid {text}: a value is given twice")
        grid.append((key.strip(), values))
    return grid


def combinations(grid: Grid) -> list[Combination]:
    """Every combination, the last setting's values changing fastest; a single empty one of an empty grid."""
    keys = [key for key, _ in grid]
    return [tuple(zip(keys, values, strict=True)) for values in itertools.product(*(values for _, values in grid))]


def label(combination: Combination) -> str:
    """A combination in one line."""
    return ", ".join(f"{key}={value}" for key, value in combination)


def split(text: str) -> list[str]:
    """``text`` at its commas, but those inside brackets or quotes."""
    parts, depth, quote, begin = [], 0, "", 0
    for place, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter in "[{(":
            depth += 1
        elif letter in "]})":
            depth -= 1
        elif letter == "," and depth == 0:
            parts.append(text[begin:place])
            begin = place + 1
    return [*parts, text[begin:]]
