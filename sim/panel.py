"""What a rectangle of a quad's plane holds: averages that are exact for rectangles and for marker cells.

The means of rectangles are products of overlaps; those of markers come from summed areas (F. Crow, "Summed-area
tables for texture mapping", 1984).
"""

from typing import NamedTuple

from flightapp.frames import Vector
from flightapp.jit import kernel

EMPTY, FLAT, MIXED = 0, 1, 2
BLUR_STEP = 0.8
"""Boxes are at most this fraction of their width apart along the path of motion."""


class Panel(NamedTuple):
    """One side of one quad; m and grey levels. Passed by value: counting references would cost more than the work."""

    s0: float
    s1: float
    t0: float
    t1: float
    hole_s0: float
    hole_s1: float
    hole_t0: float
    hole_t1: float
    shade: float


class Board(NamedTuple):
    """One marker on its white board, by value; m and grey levels."""

    s: float
    t: float
    side: float
    half: float
    black: float
    white: float


NO_BOARD = Board(0.0, 0.0, 1.0, -1.0, 0.0, 0.0)


@kernel
def _overlap(low: float, high: float, a: float, b: float) -> float:
    return max(0.0, min(high, b) - max(low, a))


@kernel
def _solid(panel: Panel, s0: float, s1: float, t0: float, t1: float) -> float:
    """Area (m²) of the panel within a rectangle."""
    outer = _overlap(s0, s1, panel.s0, panel.s1) * _overlap(t0, t1, panel.t0, panel.t1)
    return outer - _overlap(s0, s1, panel.hole_s0, panel.hole_s1) * _overlap(t0, t1, panel.hole_t0, panel.hole_t1)


@kernel
def classify(panel: Panel, s0: float, s1: float, t0: float, t1: float) -> int:
    """Whether a rectangle lies wholly off the panel (EMPTY), wholly on it (FLAT), or neither (MIXED)."""
    if s1 <= panel.s0 or s0 >= panel.s1 or t1 <= panel.t0 or t0 >= panel.t1:
        return EMPTY
    if s0 >= panel.hole_s0 and s1 <= panel.hole_s1 and t0 >= panel.hole_t0 and t1 <= panel.hole_t1:
        return EMPTY
    if s0 < panel.s0 or s1 > panel.s1 or t0 < panel.t0 or t1 > panel.t1:
        return MIXED
    if s1 > panel.hole_s0 and s0 < panel.hole_s1 and t1 > panel.hole_t0 and t0 < panel.hole_t1:
        return MIXED
    return FLAT


@kernel
def boards_at(boards: Vector, s0: float, s1: float, t0: float, t1: float) -> tuple[int, int]:
    """The boards that a rectangle may touch are those from .. to."""
    first, last = 0, 0
    for b in range(boards.shape[0]):
        half = 0.5 * boards[b, 3]
        cs, ct = boards[b, 0], boards[b, 1]
        if s1 > cs - half and s0 < cs + half and t1 > ct - half and t0 < ct + half:
            first = first if last > 0 else b
            last = b + 1
    return first, last


@kernel
def board_flat(boards: Vector, black: Vector, b: int, s0: float, s1: float, t0: float, t1: float) -> float:
    """The one brightness of board ``b`` in a rectangle that touches it; negative where there are several."""
    h, half = 0.5 * boards[b, 2], 0.5 * boards[b, 3]
    a0, a1, b0, b1 = s0 - boards[b, 0], s1 - boards[b, 0], t0 - boards[b, 1], t1 - boards[b, 1]
    if a0 < -half or a1 > half or b0 < -half or b1 > half:
        return -1.0
    if a1 <= -h or a0 >= h or b1 <= -h or b0 >= h:
        return float(boards[b, 5])
    if a0 < -h or a1 > h or b0 < -h or b1 > h:
        return -1.0
    k = black.shape[1] - 1
    scale = 0.5 * k / h
    i, j = min(int((a0 + h) * scale), k - 1), min(int((b0 + h) * scale), k - 1)
    if (a1 + h) * scale > i + 1 or (b1 + h) * scale > j + 1:
        return -1.0
    dark = black[b, j + 1, i + 1] - black[b, j, i + 1] - black[b, j + 1, i] + black[b, j, i]
    return float(boards[b, 4] if dark > 0.5 else boards[b, 5])


@kernel
def leg_mean(
    panel: Panel,
    board: Board,
    black: Vector,
    b: int,
    s: float,
    t: float,
    ds: float,
    dt: float,
    ws: float,
    wt: float,
) -> tuple[float, float]:
    """Mean coverage and covered brightness of the box (ws, wt) that moves from (s, t) by (ds, dt).

    The black area up to a point is bilinear between the grid points of the cells, which is exact.
    """
    n = 1 + int(max(abs(ds) / ws, abs(dt) / wt) / BLUR_STEP)
    k = black.shape[1] - 1
    scale = k / board.side
    cover, white, dark = 0.0, 0.0, 0.0
    for i in range(n):
        f = (i + 0.5) / n
        s0, s1 = s + f * ds - 0.5 * ws, s + f * ds + 0.5 * ws
        t0, t1 = max(t + f * dt - 0.5 * wt, panel.t0), max(t + f * dt + 0.5 * wt, panel.t0)
        cover += _solid(panel, s0, s1, t0, t1)
        clear = _overlap(s0, s1, board.s - board.half, board.s + board.half)
        clear *= _overlap(t0, t1, board.t - board.half, board.t + board.half)
        if clear <= 0.0:
            continue
        white += clear
        x0 = min(max((s0 - board.s) * scale + 0.5 * k, 0.0), float(k))
        x1 = min(max((s1 - board.s) * scale + 0.5 * k, 0.0), float(k))
        y0 = min(max((t0 - board.t) * scale + 0.5 * k, 0.0), float(k))
        y1 = min(max((t1 - board.t) * scale + 0.5 * k, 0.0), float(k))
        if x0 == x1 or y0 == y1:
            continue
        c0, c1, r0, r1 = min(int(x0), k - 1), min(int(x1), k - 1), min(int(y0), k - 1), min(int(y1), k - 1)
        u0, u1 = x0 - c0, x1 - c1
        for edge in range(2):
            r, v = (r1, y1 - r1) if edge else (r0, y0 - r0)
            left = black[b, r, c0] * (1.0 - u0) + black[b, r, c0 + 1] * u0
            left += v * (black[b, r + 1, c0] * (1.0 - u0) + black[b, r + 1, c0 + 1] * u0 - left)
            right = black[b, r, c1] * (1.0 - u1) + black[b, r, c1 + 1] * u1
            right += v * (black[b, r + 1, c1] * (1.0 - u1) + black[b, r + 1, c1 + 1] * u1 - right)
            dark += right - left if edge else left - right
    light = panel.shade * cover + (board.white - panel.shade) * white
    light += (board.black - board.white) * dark / (scale * scale)
    share = 1.0 / (n * ws * wt)
    return cover * share, light * share
