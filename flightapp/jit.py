"""How numeric kernels are compiled."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

numba.config.CACHE_LOCATOR_CLASSES = ",".join(f"flightapp.jitcache.{name}" for name in ("Named", "InTree", "UserWide"))  # type: ignore[attr-defined]

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` with numba: cached on disk, releasing the GIL.

    A kernel is typed like the plain function it was written as.
    """
    return cast(Callable[P, R], numba.njit(function, cache=True, nogil=True))


@kernel
def assign(target: NDArray[np.float64], source: NDArray[np.float64]) -> None:
    """Copy ``source`` (n,) into ``target`` (n,), inside kernels: slices assigned to slices take seconds to compile."""
    for i in range(target.size):
        target[i] = source[i]


_LEAN: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""Without numba's reference counts, whose calls cost small kernels more than their sums; floats divide as in numpy."""
_INLINED: dict[str, Any] = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def lean_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A `kernel` that makes no arrays (views are none) and so starts in half the time."""
    return cast(Callable[P, R], numba.njit(function, cache=True, **_LEAN))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` into the kernels that call it, and for nothing else; it makes no arrays.

    Python cannot call it, so it needs no wrappers and no cache file, which compiles faster.
    """
    return cast(Callable[P, R], numba.njit(function, **_LEAN, **_INLINED))


_FUSED: dict[str, Any] = {"fastmath": {"contract", "reassoc", "nsz"}}
"""Products and sums fused and summed in any order, but infinities and NaN as ever: for long sums, whose last bits do
not count."""


def fused_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A `lean_kernel` whose sums may be taken in any order."""
    return cast(Callable[P, R], numba.njit(function, cache=True, **_LEAN, **_FUSED))


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """`inlined` into a `fused_kernel`."""
    return cast(Callable[P, R], numba.njit(function, **_LEAN, **_INLINED, **_FUSED))


def shared(function: Callable[P, R]) -> Callable[P, R]:
    """`fused`, and Python can call it as well."""
    return cast(Callable[P, R], numba.njit(function, cache=True, forceinline=True, **_LEAN, **_FUSED))
