"""How numeric kernels are compiled."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

numba.config.CACHE_LOCATOR_CLASSES = ",".join(f"flightapp.jitcache.{name}" for name in ("Named", "InTree", "UserWide"))  # type: ignore[attr-defined]

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` with numba: cached on disk, releasing the GIL.

    A kernel is typed like the plain function it was written as.
    """
    return cast(Callable[P, R], numba.njit(function, cache=True, nogil=True))
