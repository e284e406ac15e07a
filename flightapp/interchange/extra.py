"""Libraries for other programs' recordings, which not everybody needs."""

from importlib import import_module
from typing import Any

from flightapp.inputs import BadInputError


def load(module: str, wanted: str) -> Any:
    """The ``module`` of the extra `interchange`, for what is ``wanted``; raises `BadInputError` where it is missing."""
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise BadInputError(f"{wanted} takes {package}, which is missing: pip install flightapp[interchange]") from None
