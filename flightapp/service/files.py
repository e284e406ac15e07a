"""Which files a client may name."""

import os
import stat
from collections.abc import Sequence
from pathlib import Path

from flightapp.inputs import BadInputError


def allowed_file(name: str, places: Sequence[Path], what: str) -> Path:
    """The regular, readable file ``name`` in one of ``places``, links resolved; raises `BadInputError`.

    ``what`` it is in words. A mission is a Python program that runs with all that the service may do: who may write
    into one of ``places`` may have the service run anything.
    """
    try:
        if not Path(name).is_absolute():
            raise BadInputError(f"{what} '{name}': give an absolute path")
        path = Path(name).resolve(strict=True)
        if not any(path.is_relative_to(place) for place in places):
            where = ", ".join(map(str, places))
            raise BadInputError(f"{what} '{name}': the service takes files from {where} alone (serve --from)")
        if not stat.S_ISREG(path.stat().st_mode):
            raise BadInputError(f"{what} '{name}': is not a regular file")
        if not os.access(path, os.R_OK):
            raise BadInputError(f"{what} '{name}': the service's user may not read it")
    except FileNotFoundError:
        raise BadInputError(f"{what} '{name}': there is no such file for the service") from None
    except (OSError, ValueError, RuntimeError) as error:  # of a name that none can have, or links in a circle
        raise BadInputError(f"{what} '{name[:100]}': {error}") from None
    return path
