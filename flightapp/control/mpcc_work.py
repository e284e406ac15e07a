"""Room for the numbers of a contouring horizon."""

from typing import NamedTuple

import numpy as np

from flightapp.config import Mpcc
from flightapp.control.mpc_model import CHANGES
from flightapp.control.mpc_model import INPUTS as DRIVEN
from flightapp.control.mpc_model import STATE as BODY
from flightapp.control.mpc_model import TANGENT as BODY_TANGENT
from flightapp.control.mpcc_cost import REFERENCE
from flightapp.control.parameters import Parameters
from flightapp.control.riccati import WIDE
from flightapp.frames import Vector

PROGRESS = 2
"""Numbers of the progress, which lead those of the vehicle: the line's time (s), and its rate."""
STATE, TANGENT, INPUTS = PROGRESS + BODY, PROGRESS + BODY_TANGENT, DRIVEN + 1


class Contour(NamedTuple):
    """How a line is flown along; numbers of the configuration."""

    rate_min: float
    rate_max: float
    ahead: float
    """s."""
    behind: float
    """s."""
    reach: float
    """m, the same at most as distances."""
    near: float
    """Share of the bandwidths at a gate."""
    away: float
    """Share of the bandwidths far from all."""
    zone: float
    """m."""
    progress: float
    """m²/s⁴, weight of a rate that is less than it may be."""
    steady: float
    """m²/s², weight of the rate's change per second."""


class ContourWork(NamedTuple):
    """All that is remembered of a horizon of n steps, so that nothing is allocated in flight; see `mpc_work.Work`."""

    believed: Vector
    contour: Vector
    """`Contour`."""
    line: Vector
    """Greatest speed of the line (m/s), then the times of its gates (s), ascending."""
    grid: Vector
    bounds: Vector
    """(n, 2, 5) least and greatest inputs of each step."""
    reference: Vector
    """(n + 1, REFERENCE) at the ends of the steps; the first is not used."""
    asked: Vector
    """(n, 4) body rates as a world vector, and thrust, that the reference needs in the middle of each step."""
    wanted: Vector
    """(n, 4) the same as inputs, seen from the planned attitudes."""
    off: Vector
    """(n, 4) inputs planned less those wanted."""
    rates: Vector
    """(n + 1,) rate of the progress at the beginning, and at the end of each step."""
    spare: Vector
    """(n + 1,) room for the rates while they are carried on."""
    x: Vector
    """(n + 1, STATE) planned states."""
    u: Vector
    """(n, 5) planned inputs: body rates, thrust, and the rate of the progress at the step's end."""
    tried_x: Vector
    tried_u: Vector
    feed: Vector
    gains: Vector
    changes: Vector
    value: Vector
    half: Vector
    across: Vector
    full: Vector
    small: Vector
    lines: Vector
    difference: Vector


def contour_of(settings: Mpcc, kp: float, reach: float) -> Contour:
    """The numbers of ``settings``, for the position gain ``kp`` (1/s²), never further than ``reach`` m off its time."""
    progress = (kp * settings.worth) ** 2
    return Contour(
        *(settings.rate_min, settings.rate_max, settings.ahead, settings.behind, reach),
        *(settings.gate_stiffness, settings.stiffness, settings.gate_zone),
        *(progress, progress / settings.progress_bandwidth**2),
    )


def room(p: Parameters, contour: Contour, grid: Vector) -> ContourWork:
    """For the steps ``grid`` (n, GRID) of the vehicle ``p``."""
    n, both = len(grid), TANGENT + INPUTS
    sizes = (
        *((n, 2, INPUTS), (n + 1, REFERENCE), (n, DRIVEN), (n, DRIVEN), (n, DRIVEN), (n + 1,), (n + 1,)),
        *((n + 1, STATE), (n, INPUTS)) * 2,
        *((n, INPUTS), (n, INPUTS * WIDE), (CHANGES,)),
        *((TANGENT * WIDE,), (both * WIDE,), (TANGENT * WIDE,), (both * WIDE,)),
        *((2 * INPUTS + 2, INPUTS), (4, INPUTS), (TANGENT,)),
    )
    work = ContourWork._make([np.array(p), np.array(contour), np.ones(1), grid, *(np.zeros(size) for size in sizes)])
    work.rates[:] = 1.0
    return work
