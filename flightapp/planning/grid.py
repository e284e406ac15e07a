"""The compiled part of `corridor` that searches for a way around what is in the way.

The search is A* (P. Hart, N. Nilsson and B. Raphael, 1968) on a grid with 26 neighbours to a node. How far a node is
from what is in the way is only found out when the search gets there.
"""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from flightapp.frames import Vector
from flightapp.jit import assign, inlined, kernel, lean_kernel
from flightapp.planning.legs import deepest

Indices = NDArray[np.int64]

MOVES = np.array([(*move, math.hypot(*move)) for move in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(move)])
"""(26, 4) steps to the neighbours of a node and their lengths, all in cells; an argument, or it would be unrolled."""


@inlined
def _least_way(x: float, y: float, z: float) -> float:
    """Length in m of the shortest way on the grid over ``x``, ``y``, ``z`` m where nothing is in the way."""
    least, most = min(x, y, z), max(x, y, z)
    middle = x + y + z - least - most
    return math.sqrt(3.0) * least + math.sqrt(2.0) * (middle - least) + (most - middle)


@inlined
def _rise(heap: Indices, slot: Indices, key: Vector, i: int) -> None:
    """Put what is in slot ``i`` of a binary heap of nodes by ``key`` where it belongs, further up."""
    node = heap[i]
    while i > 0 and key[heap[(i - 1) // 2]] > key[node]:
        heap[i] = heap[(i - 1) // 2]
        slot[heap[i]] = i
        i = (i - 1) // 2
    heap[i] = node
    slot[node] = i


@inlined
def _drop_first(heap: Indices, slot: Indices, key: Vector, used: int) -> None:
    """Take the first of the ``used`` nodes of a heap out of it."""
    node = heap[used - 1]
    i = 0
    while True:
        child = 2 * i + 1
        if child + 1 < used - 1 and key[heap[child + 1]] < key[heap[child]]:
            child += 1
        if child >= used - 1 or key[heap[child]] >= key[node]:
            break
        heap[i] = heap[child]
        slot[heap[i]] = i
        i = child
    heap[i] = node
    slot[node] = i


@lean_kernel
def _node_at(grid: Vector, node: int, p: Vector) -> None:
    """Fill ``p`` (3,) m with the place of ``node``."""
    columns, layers = int(grid[5]), int(grid[6])
    p[0] = grid[0] + grid[3] * (node // (columns * layers))
    p[1] = grid[1] + grid[3] * (node // layers % columns)
    p[2] = grid[2] + grid[3] * (node % layers)


@lean_kernel
def _spread(
    grid: Vector,
    moves: Vector,
    goal: Vector,
    rows: Vector,
    reach: Vector,
    toll: float,
    greed: float,
    nodes: Indices,
    marks: Vector,
    scratch: Vector,
    used: int,
) -> int:
    """Take the first node off the heap and put its neighbours on it; returns how many there are then, -1 at the goal.

    ``grid`` (7,) is its first corner (3) m, its cell in m and its size (3); ``nodes`` (3, n) the heap, each node's slot
    on it (-1 not yet, -2 not any more) and the node before it; ``marks`` (3, n) each node's cost, key and price, all m.
    The last row of ``scratch`` (3, 3) counts the nodes that are looked at for the first time.
    """
    heap, slot, parent = nodes[0], nodes[1], nodes[2]
    cost, key, price = marks[0], marks[1], marks[2]
    p, gradient = scratch[0], scratch[1]
    size0, size1, size2 = int(grid[4]), int(grid[5]), int(grid[6])
    cell = grid[3]
    node = heap[0]
    _node_at(grid, node, p)
    if (p[0] - goal[0]) ** 2 + (p[1] - goal[1]) ** 2 + (p[2] - goal[2]) ** 2 <= 3.0 * cell * cell:
        return -1
    _drop_first(heap, slot, key, used)
    used -= 1
    slot[node] = -2
    x, y, z = node // (size1 * size2), node // size2 % size1, node % size2
    for move in moves:
        i, j, k = x + int(move[0]), y + int(move[1]), z + int(move[2])
        if i < 0 or j < 0 or k < 0 or i >= size0 or j >= size1 or k >= size2:
            continue
        other = (i * size1 + j) * size2 + k
        if slot[other] == -2:
            continue
        p[0], p[1], p[2] = grid[0] + cell * i, grid[1] + cell * j, grid[2] + cell * k
        if price[other] < 0.0:
            found, depth = deepest(p, rows, reach, gradient)
            price[other] = toll * depth if found >= 0 else 0.0
            scratch[2, 0] += 1.0
        through = cost[node] + cell * move[3] + price[other]
        if through < cost[other]:
            cost[other], parent[other] = through, node
            key[other] = through + greed * _least_way(abs(p[0] - goal[0]), abs(p[1] - goal[1]), abs(p[2] - goal[2]))
            if slot[other] < 0:
                heap[used] = other
                slot[other] = used
                used += 1
            _rise(heap, slot, key, slot[other])
    return used


@kernel
def search(
    start: Vector,
    goal: Vector,
    rows: Vector,
    reach: Vector,
    low: Vector,
    high: Vector,
    cell: float,
    toll: float,
    greed: float,
    moves: Vector,
    most: float,
) -> tuple[Vector, float]:
    """A way from ``start`` to ``goal`` (3,) m at ``reach`` (k,) m from ``rows``: (n, 3) m, both ends included.

    It keeps to nodes ``cell`` m apart within ``low`` .. ``high`` (3,) m. There are no rows in it if there is no way, or
    none is found among ``most`` nodes; a ``toll`` that is finite lets it come closer, for so many m of
    way per m at each node. The more ``greed``, the fewer nodes it looks at, and the way may be as many times longer as
    it needs to be. ``moves`` are `MOVES`. Also returns how many nodes were looked at.
    """
    grid = np.empty(7)
    grid[3] = cell
    node, count = 0, 1
    for j in range(3):
        before = int((start[j] - low[j]) / cell)
        size = before + int((high[j] - start[j]) / cell) + 1
        grid[j], grid[4 + j] = start[j] - cell * before, size
        node, count = node * size + before, count * size
    nodes, marks, scratch = np.empty((3, count), np.int64), np.empty((3, count)), np.zeros((3, 3))
    for i in range(count):
        nodes[1, i] = nodes[2, i] = -1
        marks[0, i], marks[2, i] = math.inf, -1.0
    nodes[0, 0], nodes[1, node], marks[0, node], marks[1, node] = node, 0, 0.0, 0.0
    used = 1
    while used > 0 and scratch[2, 0] < most:
        used = _spread(grid, moves, goal, rows, reach, toll, greed, nodes, marks, scratch, used)
    return _trail(grid, nodes[2], nodes[0, 0], goal, used < 0), scratch[2, 0]


@kernel
def _trail(grid: Vector, parent: Indices, last: int, goal: Vector, found: bool) -> Vector:
    """The places of the nodes on the way to node ``last``, then ``goal``; no rows if none was ``found``."""
    n = 0
    node = last if found else -1
    while node >= 0:
        n += 1
        node = parent[node]
    out = np.empty((n + 1 if n > 0 else 0, 3))
    node = last
    for i in range(n - 1, -1, -1):
        _node_at(grid, node, out[i])
        node = parent[node]
    if n > 0:
        assign(out[n], goal)
    return out
