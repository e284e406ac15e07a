"""Carries what inequalities contribute at a segment's samples over to its two knots."""

import numpy as np

from flightapp.frames import Vector
from flightapp.jit import fused
from flightapp.planning.race_rows import (
    AT_AA,
    AT_FF,
    AT_FJ,
    AT_FOLDED,
    AT_JJ,
    AT_MOVED,
    AT_PP,
    AT_PULL,
    AT_VV,
    COLUMNS,
    S,
)
from flightapp.planning.race_samples import AT_F, AT_J, AT_V, BY_ENTRY, BY_SAMPLE, DURATION, ENTRIES
from flightapp.planning.race_work import Work

MIXED = np.array([(3 * a + b, 3 * b + a) for a in range(3) for b in range(a, 3)])
"""(6, 2) for each pair of axes, the rows of force along the first with jerk along the second, and the reverse."""


def _paired(a: int, e: int, b: int, f: int) -> int:
    """Where in `Work.pairs` the second derivative is by entry ``e`` along axis ``a`` and entry ``f`` along ``b``."""
    if a > b:
        a, e, b, f = b, f, a, e
    return COLUMNS * e + ENTRIES * (3 * a - a * (a + 1) // 2 + b) + f


PLACED = np.array(
    [
        (3 * d + a, 3 * f + b, d + f, _paired(a, 4 + d, b, f), _paired(a, d, b, f), _paired(a, 4 + d, b, 4 + f))
        for d in range(4)
        for a in range(3)
        for f in range(4)
        for b in range(3)
    ]
)
"""(144, 6) row and column of a block, power of the duration, and where in `Work.pairs` is what belongs there: under the
diagonal, and on it for the near and the far knot."""


@fused
def _carry_sums(duration: float, work: Work) -> None:
    """Fill ``work.totals`` with what the samples' sums are by the scaled ends of the segment."""
    s, totals = work.samples, work.totals
    s1 = 1.0 / duration
    s2, s3 = s1 * s1, s1 * s1 * s1
    for a in range(totals.shape[1]):
        right, by_duration = totals[0, a], totals[1, a]
        for e in range(ENTRIES):
            right[e] = by_duration[e] = 0.0
        for k in range(S):
            b, p, m = BY_SAMPLE[k], AT_PULL + a * S + k, AT_MOVED + a * S + k
            x0, x1, x2, x3 = s[p], s1 * s[p + AT_V], s2 * s[p + AT_F], s3 * s[p + AT_J]
            z0, z1, z2, z3 = s[m], s1 * s[m + AT_V], s2 * s[m + AT_F], s3 * s[m + AT_J]
            for e in range(ENTRIES):
                right[e] -= x0 * b[0, e] + x1 * b[1, e] + x2 * b[2, e] + x3 * b[3, e]
                by_duration[e] += z0 * b[0, e] + z1 * b[1, e] + z2 * b[2, e] + z3 * b[3, e]


@fused
def _fold(pair: int, mixed: int, other: int, duration: float, drag: float, s: Vector) -> None:
    """Fill rows of a pair of axes with the second derivative by velocity, acceleration and jerk, in scaled units.

    With ``drag`` the force depends on velocity, too, and its derivative on acceleration.
    """
    to, one, two = AT_FOLDED + 9 * S * pair, AT_FJ + mixed * S, AT_FJ + other * S
    s1, d2 = 1.0 / duration, drag * drag
    s2 = s1 * s1
    s3, s4 = s2 * s1, s2 * s2
    s5, s6 = s4 * s1, s4 * s2
    for k in range(S):
        ff, jj, fj, jf = s[AT_FF + pair * S + k], s[AT_JJ + pair * S + k], s[one + k], s[two + k]
        s[to + k] = s2 * (s[AT_VV + pair * S + k] + d2 * ff)
        s[to + S + k] = s3 * (drag * ff + d2 * fj)
        s[to + 2 * S + k] = s4 * drag * fj
        s[to + 3 * S + k] = s3 * (drag * ff + d2 * jf)
        s[to + 4 * S + k] = s4 * (ff + s[AT_AA + pair * S + k] + drag * (fj + jf) + d2 * jj)
        s[to + 5 * S + k] = s5 * (fj + drag * jj)
        s[to + 6 * S + k] = s4 * drag * jf
        s[to + 7 * S + k] = s5 * (jf + drag * jj)
        s[to + 8 * S + k] = s6 * jj


@fused
def _carry_half(with_places: bool, work: Work) -> int:
    """Fill ``work.carried``: second derivatives by samples and scaled entries. How many orders of derivative it has."""
    s, carried = work.samples, work.carried
    # Read from an array, as loops of known length are unrolled and not done side by side.
    entries = work.totals.shape[2]
    for pair in range(6):
        for k in range(S):
            at, to = AT_FOLDED + 9 * S * pair + k, COLUMNS * k + ENTRIES * pair
            b = BY_SAMPLE[k]
            vv, va, vj = s[at], s[at + S], s[at + 2 * S]
            av, aa, aj = s[at + 3 * S], s[at + 4 * S], s[at + 5 * S]
            jv, ja, jj = s[at + 6 * S], s[at + 7 * S], s[at + 8 * S]
            for e in range(entries):
                carried[to + e] = vv * b[1, e] + va * b[2, e] + vj * b[3, e]
                carried[to + COLUMNS * S + e] = av * b[1, e] + aa * b[2, e] + aj * b[3, e]
                carried[to + 2 * COLUMNS * S + e] = jv * b[1, e] + ja * b[2, e] + jj * b[3, e]
            if with_places:
                for e in range(entries):
                    carried[to + 3 * COLUMNS * S + e] = s[AT_PP + S * pair + k] * b[0, e]
    return 4 if with_places else 3


@fused
def _carry_curvature(orders: int, work: Work) -> None:
    """Fill ``work.pairs`` with the second derivative by the segment's scaled ends, from ``work.carried``."""
    carried, pairs = work.carried, work.pairs
    for m in range(ENTRIES * COLUMNS):
        pairs[m] = 0.0
    for order in range(orders):
        d = (order + 1) % 4
        for e in range(ENTRIES):
            b, to = BY_ENTRY[d, e], COLUMNS * e
            for k in range(0, S, 6):
                b0, b1, b2, b3, b4, b5 = b[k], b[k + 1], b[k + 2], b[k + 3], b[k + 4], b[k + 5]
                at = COLUMNS * (S * order + k)
                for m in range(COLUMNS):
                    first = b0 * carried[at + m] + b1 * carried[at + COLUMNS + m] + b2 * carried[at + 2 * COLUMNS + m]
                    pairs[to + m] += first + (
                        b3 * carried[at + 3 * COLUMNS + m]
                        + b4 * carried[at + 4 * COLUMNS + m]
                        + b5 * carried[at + 5 * COLUMNS + m]
                    )


@fused
def _scatter(i: int, duration: float, work: Work) -> None:
    """Add the sums of segment ``i`` to the blocks of its two knots, of those on the diagonal to the lower halves."""
    near, far, below = work.diagonal[i], work.diagonal[i + 1], work.below[i]
    totals, pairs, powers = work.totals, work.pairs, work.powers
    powers[0] = 1.0
    for d in range(1, 7):
        powers[d] = duration * powers[d - 1]
    for d in range(4):
        for a in range(3):
            row, scale = 3 * d + a, powers[d]
            work.right[i, row] += scale * totals[0, a, d]
            work.right[i + 1, row] += scale * totals[0, a, 4 + d]
            near[DURATION, row] += scale * totals[1, a, d]
            below[row, DURATION] = scale * totals[1, a, 4 + d]
    for m in range(PLACED.shape[0]):
        row, column = PLACED[m, 0], PLACED[m, 1]
        scale = powers[PLACED[m, 2]]
        below[row, column] = scale * pairs[PLACED[m, 3]]
        if column <= row:
            near[row, column] += scale * pairs[PLACED[m, 4]]
            far[row, column] += scale * pairs[PLACED[m, 5]]


@fused
def carry(i: int, duration: float, drag: float, with_places: bool, work: Work) -> None:
    """Add the sums at the samples of segment ``i`` to the equations' blocks and right-hand side."""
    _carry_sums(duration, work)
    for pair in range(6):
        _fold(pair, MIXED[pair, 0], MIXED[pair, 1], duration, drag, work.samples)
    _carry_curvature(_carry_half(with_places, work), work)
    _scatter(i, duration, work)
