"""Quads into pixels: exact for any lens, with area sampling and motion blur.

The plane of a quad is a homography of the ray through a pixel, so each pixel is intersected exactly. A pixel sees
the mean over a box in the quad's plane that has the variance of the camera's point spread. Motion blur is the mean
of such boxes along the path that the pixel draws over the plane during the exposure. Quads are painted from far
to near, tile by tile; tiles that see nothing of a quad, or one brightness, cost next to nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import kernel
from sim.ground import Image
from sim.panel import EMPTY, FLAT, MIXED, NO_BOARD, Board, Panel, board_flat, boards_at, classify, leg_mean
from sim.scene import Boards, Quads

TILE = 8
PSF_SIGMA = 0.6
"""px, standard deviation of the point spread, the pixel's own aperture included: a good lens in focus."""
BOX = math.sqrt(12.0) * PSF_SIGMA
"""px, width of the box of that standard deviation."""
TOUCHING = 1e-5
"""1/m, rays that meet a plane at less than this inverse distance count as parallel to it."""
LENS_ROOM = 0.1
"""Share of a tile's extent by which the lens may bend its sides."""


@kernel
def _box_width(rays: Image, y: int, x: int, H: Vector) -> tuple[float, float]:
    """Width in s and t, m, of the box with the variance of the point spread at pixel (x, y), first pose.

    Not positive where the ray misses the plane.
    """
    d0, d1, d2 = float(rays[y, x, 0]), float(rays[y, x, 1]), float(rays[y, x, 2])
    w = H[0, 2, 0] * d0 + H[0, 2, 1] * d1 + H[0, 2, 2] * d2
    if w <= TOUCHING:
        return -1.0, -1.0
    s = (H[0, 0, 0] * d0 + H[0, 0, 1] * d1 + H[0, 0, 2] * d2) / w
    t = (H[0, 1, 0] * d0 + H[0, 1, 1] * d1 + H[0, 1, 2] * d2) / w
    ss, tt = 0.0, 0.0
    for step in range(2):
        ny = y if step == 0 else (y + 1 if y + 1 < rays.shape[0] else y - 1)
        nx = x if step == 1 else (x + 1 if x + 1 < rays.shape[1] else x - 1)
        e0, e1, e2 = rays[ny, nx, 0] - d0, rays[ny, nx, 1] - d1, rays[ny, nx, 2] - d2
        dw = H[0, 2, 0] * e0 + H[0, 2, 1] * e1 + H[0, 2, 2] * e2
        ss += (H[0, 0, 0] * e0 + H[0, 0, 1] * e1 + H[0, 0, 2] * e2 - s * dw) ** 2
        tt += (H[0, 1, 0] * e0 + H[0, 1, 1] * e1 + H[0, 1, 2] * e2 - t * dw) ** 2
    return BOX * math.sqrt(ss) / w, BOX * math.sqrt(tt) / w


@kernel
def _trace_tile(rays: Image, y0: int, y1: int, x0: int, x1: int, H: Vector, path: Vector, width: Vector) -> None:
    """Fill ``path`` (TILE², n, 2) m with s, t of each pixel at each pose, ``width`` (TILE², 2) m with its box.

    The box is that of the middle of the tile's row, or, at the rim of the lens or the plane's horizon, the pixel's
    own; not positive where the ray misses the plane.
    """
    for y in range(y0, y1):
        row_ws, row_wt = _box_width(rays, y, (x0 + x1) // 2, H)
        for x in range(x0, x1):
            i = (y - y0) * TILE + x - x0
            d0, d1, d2 = float(rays[y, x, 0]), float(rays[y, x, 1]), float(rays[y, x, 2])
            ws, wt = row_ws, row_wt
            if ws <= 0.0 or wt <= 0.0:
                ws, wt = _box_width(rays, y, x, H)
            for k in range(H.shape[0]):
                w = H[k, 2, 0] * d0 + H[k, 2, 1] * d1 + H[k, 2, 2] * d2
                if w <= TOUCHING:
                    ws = -1.0
                inverse = 1.0 / max(w, TOUCHING)
                path[i, k, 0] = (H[k, 0, 0] * d0 + H[k, 0, 1] * d1 + H[k, 0, 2] * d2) * inverse
                path[i, k, 1] = (H[k, 1, 0] * d0 + H[k, 1, 1] * d1 + H[k, 1, 2] * d2) * inverse
            width[i, 0], width[i, 1] = ws, wt


@kernel
def _paint_tile(
    image: Image,
    y0: int,
    y1: int,
    x0: int,
    x1: int,
    panel: Panel,
    boards: Vector,
    black: Vector,
    path: Vector,
    width: Vector,
) -> None:
    """Lay over the tile the mean of each pixel's box along its ``path``; see `_trace_tile`."""
    legs = path.shape[1] - 1
    for y in range(y0, y1):
        for x in range(x0, x1):
            i = (y - y0) * TILE + x - x0
            ws, wt = width[i, 0], width[i, 1]
            if ws <= 0.0 or wt <= 0.0:
                continue
            cover, light = 0.0, 0.0
            for leg in range(legs):
                s, t = path[i, leg, 0], path[i, leg, 1]
                ds, dt = path[i, leg + 1, 0] - s, path[i, leg + 1, 1] - t
                s0, s1 = s + min(ds, 0.0) - 0.5 * ws, s + max(ds, 0.0) + 0.5 * ws
                t0, t1 = t + min(dt, 0.0) - 0.5 * wt, t + max(dt, 0.0) + 0.5 * wt
                kind = classify(panel, s0, s1, t0, t1)
                if kind == EMPTY:
                    continue
                board, b = NO_BOARD, 0
                for j in range(boards.shape[0]):
                    cs, ct, half = boards[j, 0], boards[j, 1], 0.5 * boards[j, 3]
                    if s1 > cs - half and s0 < cs + half and t1 > ct - half and t0 < ct + half:
                        board, b = Board(cs, ct, boards[j, 2], half, boards[j, 4], boards[j, 5]), j
                level = -1.0
                if kind == FLAT:
                    level = panel.shade if board.half < 0.0 else board_flat(boards, black, b, s0, s1, t0, t1)
                if level >= 0.0:
                    cover += 1.0
                    light += level
                else:
                    c, brightness = leg_mean(panel, board, black, b, s, t, ds, dt, ws, wt)
                    cover += c
                    light += brightness
            image[y, x] += (light - cover * image[y, x]) / legs


@kernel
def _tile_content(
    rays: Image, y0: int, y1: int, x0: int, x1: int, panel: Panel, boards: Vector, black: Vector, H: Vector
) -> tuple[int, float, int, int]:
    """What a tile sees of the panel during the exposure: nothing, one brightness, or a mix; that; boards from .. to."""
    low_s, high_s, low_t, high_t = math.inf, -math.inf, math.inf, -math.inf
    past = 0
    for corner in range(4):
        y = y1 - 1 if corner & 1 else y0
        x = x1 - 1 if corner & 2 else x0
        d0, d1, d2 = float(rays[y, x, 0]), float(rays[y, x, 1]), float(rays[y, x, 2])
        for k in range(H.shape[0]):
            w = H[k, 2, 0] * d0 + H[k, 2, 1] * d1 + H[k, 2, 2] * d2
            past += w <= TOUCHING
            inverse = 1.0 / max(w, TOUCHING)
            s = (H[k, 0, 0] * d0 + H[k, 0, 1] * d1 + H[k, 0, 2] * d2) * inverse
            t = (H[k, 1, 0] * d0 + H[k, 1, 1] * d1 + H[k, 1, 2] * d2) * inverse
            low_s, high_s = min(low_s, s), max(high_s, s)
            low_t, high_t = min(low_t, t), max(high_t, t)
    if past > 0:
        return (EMPTY if past == 4 * H.shape[0] else MIXED), 0.0, 0, boards.shape[0]
    room = 0.5 * BOX / max(min(y1 - y0, x1 - x0) - 1, 1) + LENS_ROOM
    ps, pt = room * (high_s - low_s), room * (high_t - low_t)
    low_s, high_s, low_t, high_t = low_s - ps, high_s + ps, low_t - pt, high_t + pt
    kind = classify(panel, low_s, high_s, low_t, high_t)
    first, last = boards_at(boards, low_s, high_s, low_t, high_t)
    if kind != FLAT or first == last:
        return kind, panel.shade, first, last
    level = board_flat(boards, black, first, low_s, high_s, low_t, high_t)
    return (FLAT if level >= 0.0 else MIXED), level, first, last


@kernel
def quad_homographies(quads: Quads, q: int, R_wc: Vector, centres: Vector, H: Vector) -> int:
    """Fill ``H`` (n, 3, 3) with ray → (s·w, t·w, w) of quad ``q`` at each pose; w is 1/distance along the ray.

    Returns 0 for the front, 1 for the back, -1 where it cannot be seen.
    """
    a, b = quads.along[q], quads.up[q]
    side = 0
    for k in range(len(H)):
        r = centres[k] - quads.origin[q]
        n = np.array((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
        height = r[0] * n[0] + r[1] * n[1] + r[2] * n[2]
        if abs(height) < 1e-4:
            return -1
        s = r[0] * a[0] + r[1] * a[1] + r[2] * a[2]
        t = r[0] * b[0] + r[1] * b[1] + r[2] * b[2]
        for j in range(3):
            R0, R1, R2 = R_wc[k, 0, j], R_wc[k, 1, j], R_wc[k, 2, j]
            w = -(n[0] * R0 + n[1] * R1 + n[2] * R2) / height
            H[k, 0, j] = a[0] * R0 + a[1] * R1 + a[2] * R2 + s * w
            H[k, 1, j] = b[0] * R0 + b[1] * R1 + b[2] * R2 + t * w
            H[k, 2, j] = w
        if k == len(H) // 2:
            side = 0 if height < 0.0 else 1
    return side if quads.shade[q, side] >= 0.0 else -1


@kernel
def _paint_panel(
    image: Image,
    rays: Image,
    cones: Vector,
    panel: Panel,
    boards: Vector,
    black: Vector,
    H: Vector,
    towards: Vector,
    reach: float,
) -> None:
    """Paint a panel that lies within ``reach`` rad of the unit ray ``towards`` (3,), camera frame."""
    path, width = np.empty((TILE * TILE, H.shape[0], 2)), np.empty((TILE * TILE, 2))
    tx, ty, tz = towards[0], towards[1], towards[2]
    cos_reach, sin_reach = math.cos(reach), math.sin(reach)
    for row in range(cones.shape[0]):
        y0, y1 = row * TILE, min((row + 1) * TILE, image.shape[0])
        for column in range(cones.shape[1]):
            along = cones[row, column, 0] * tx + cones[row, column, 1] * ty + cones[row, column, 2] * tz
            if reach < math.pi and along < cones[row, column, 3] * cos_reach - cones[row, column, 4] * sin_reach:
                continue
            x0, x1 = column * TILE, min((column + 1) * TILE, image.shape[1])
            kind, shade, first, last = _tile_content(rays, y0, y1, x0, x1, panel, boards, black, H)
            if kind == FLAT:
                for y in range(y0, y1):
                    for x in range(x0, x1):
                        image[y, x] = shade
            elif kind == MIXED:
                _trace_tile(rays, y0, y1, x0, x1, H, path, width)
                _paint_tile(image, y0, y1, x0, x1, panel, boards[first:last], black[first:last], path, width)


@kernel
def paint_quads(
    image: Image,
    rays: Image,
    cones: Vector,
    quads: Quads,
    boards: Boards,
    order: NDArray[np.int64],
    spheres: Vector,
    R_wc: Vector,
    centres: Vector,
    turn: float,
) -> None:
    """Paint the quads over ``image`` (h, w), from far to near.

    ``rays`` (h, w, 3) are unit rays in the camera frame, zero outside the lens; ``cones`` (rows, columns, 5) the
    axis, cosine and sine of the half-angle of each tile's cone; ``order`` (n,) the quads from far to near;
    ``spheres`` (n, 4) the ball around each; ``R_wc`` (k, 3, 3) and ``centres`` (k, 3) m the poses at equal
    intervals; ``turn`` rad how far the camera turns during the exposure.
    """
    H = np.empty((len(R_wc), 3, 3))
    m = len(R_wc) // 2
    shift = math.sqrt(np.sum((centres[-1] - centres[0]) ** 2))
    for q in order:
        side = quad_homographies(quads, q, R_wc, centres, H)
        if side < 0:
            continue
        bound, hole = quads.bounds[q], quads.hole[q]
        shade = quads.shade[q, side]
        panel = Panel(bound[0], bound[1], bound[2], bound[3], hole[0], hole[1], hole[2], hole[3], shade)
        first, last = quads.boards[q]
        if side == 1:
            last = first
        away = spheres[q, :3] - centres[m]
        towards = R_wc[m, 0] * away[0] + R_wc[m, 1] * away[1] + R_wc[m, 2] * away[2]
        distance = math.sqrt(np.sum(towards**2))
        radius = spheres[q, 3] + shift
        reach = math.asin(radius / distance) + turn if distance > radius else math.pi
        _paint_panel(
            image, rays, cones, panel, boards.look[first:last], boards.black[first:last], H, towards / distance, reach
        )
