"""Where compiled kernels are kept, and when they are stale.

Numba judges a cached kernel by its own source file alone, but a kernel also holds the constants and the
kernels of the modules that it imports. The locators here take those modules' sources into account, so that
an update never flies old code.
"""

import functools
import hashlib
import re
import sys
from pathlib import Path

from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

IMPORT = re.compile(r"^(?:from|import) ((?:flightapp|sim)[\w.]*)(?: import ([\w, ]+|\())?", re.MULTILINE)


def sources(path: Path) -> frozenset[Path]:
    """``path`` and every module of this project that it imports, directly or not."""
    found: set[Path] = set()
    pending = {path.resolve()}
    while pending:
        source = pending.pop()
        found.add(source)
        pending |= _imports(source) - found
    return frozenset(found)


@functools.cache
def _imports(path: Path) -> frozenset[Path]:
    names = set()
    for module, imported in IMPORT.findall(path.read_text(encoding="utf-8")):
        names.add(module)
        names.update(f"{module}.{name.strip()}" for name in imported.split(",") if name.strip(" ("))
    files = (getattr(sys.modules.get(name), "__file__", None) for name in names)
    return frozenset(Path(file).resolve() for file in files if file)


@functools.cache
def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


class _BySources:
    """A locator whose stamp covers the imported modules."""

    _py_file: str

    def get_source_stamp(self) -> str:
        """Digest of all the sources that the kernel may depend on."""
        whole = hashlib.sha256()
        for source in sorted(sources(Path(self._py_file))):
            whole.update(_digest(source))
        return whole.hexdigest()


class Named(_BySources, UserProvidedCacheLocator):
    """In the directory that NUMBA_CACHE_DIR names, if it does."""


class InTree(_BySources, InTreeCacheLocator):
    """Beside the module, where that can be written."""


class UserWide(_BySources, UserWideCacheLocator):
    """In the user's cache directory."""
