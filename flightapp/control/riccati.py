"""One step of Riccati's recursion where some inputs are held by their bounds.

After Y. Tassa, N. Mansard and E. Todorov, "Control-limited differential dynamic programming" (2014). Each matrix lies
in one line of numbers, with `WIDE` places to a row, and what is done to a row is done to all of them: so the compiler
knows that rows do not overlap, and takes four or more of their numbers at a time. It would rather write such a loop
out, one number after the other, where it knows that there are twenty; so that is counted.
"""

from flightapp.frames import Vector
from flightapp.jit import fused

WIDE = 20
"""Places in a row: enough for 15 states and 5 inputs, and whole registers."""


@fused
def places(matrix: Vector, rows: int) -> int:
    """`WIDE`, of a ``matrix`` (rows WIDE,)."""
    return int(matrix.shape[0] // rows)


@fused
def answer(
    full: Vector,
    half: Vector,
    L: Vector,
    free: Vector,
    feed: Vector,
    gains: Vector,
    value: Vector,
    states: int,
    inputs: int,
) -> None:
    """How a free input answers to changes of a state, and what the state is then worth, for n states and m inputs.

    ``full`` ((n + m) WIDE,) is the second derivative by state and input, ``half`` ((n + m) WIDE,) has the first in
    column n, ``L`` (m, m) factorises the inputs' own part where they are ``free`` (m,), its diagonal inverted, and
    ``feed`` (m,) is the inputs' best change. ``gains`` (m WIDE,) are filled, and of ``value`` (n WIDE,) the first n
    columns with the second derivative, the next with the first; what is in the columns after those means nothing.
    """
    wide = places(value, states)
    _solve(full, L, free, gains, states, inputs, wide)
    for i in range(states):
        slope = half[WIDE * i + states]
        for m in range(inputs):
            slope += full[WIDE * (states + m) + i] * feed[m]
        for c in range(wide):
            total = full[WIDE * i + c]
            for m in range(inputs):
                total += full[WIDE * (states + m) + i] * gains[WIDE * m + c]
            value[WIDE * i + c] = total
        value[WIDE * i + states] = slope


@fused
def _solve(full: Vector, L: Vector, free: Vector, gains: Vector, states: int, inputs: int, wide: int) -> None:
    """The ``gains`` of `answer`."""
    for i in range(inputs):
        held, inverse = -free[i], L[i, i]
        for c in range(wide):
            total = held * full[WIDE * (states + i) + c]
            for m in range(i):
                total -= L[i, m] * gains[WIDE * m + c]
            gains[WIDE * i + c] = total * inverse
    for i in range(inputs - 1, -1, -1):
        inverse = L[i, i]
        for c in range(wide):
            total = gains[WIDE * i + c]
            for m in range(i + 1, inputs):
                total -= L[m, i] * gains[WIDE * m + c]
            gains[WIDE * i + c] = total * inverse


@fused
def transpose(half: Vector, across: Vector, states: int, both: int) -> None:
    """``across`` (n WIDE,) from the first n columns of ``half`` ((n + m) WIDE,); ``both`` is n + m."""
    for i in range(states):
        for c in range(both):
            across[WIDE * i + c] = half[WIDE * c + i]
