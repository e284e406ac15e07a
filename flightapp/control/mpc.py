"""Trajectory tracking by model-predictive control: the inputs of the next moments are planned anew at every tick.

Each tick takes the vehicle as it is foreseen at the moment when its command acts, improves the plan of the tick before
for what lies ahead of that, with lags, drag and limits, and sends the plan's first input. The flatness controller,
whose foresight and memory of commands and disturbances it relies on, stands by with a command of its own for each tick.
"""

import math
from collections import Counter
from enum import StrEnum

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.flatness import FlatnessController
from flightapp.control.mpc_horizon import look_ahead
from flightapp.control.mpc_model import INPUTS, STATE
from flightapp.control.mpc_solver import NO_PROGRESS, NOT_FINITE, PLANNED, plan
from flightapp.control.mpc_work import Work, room, steps_of
from flightapp.control.parameters import Parameters, parameters_of, unpacked
from flightapp.control.vectors import axes, dot
from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel, lean_kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import Trajectory

LATE = 3.5
"""Periods after the tick before, from which on a tick is late: the computer is short of time."""
ASTRAY_COSINE = -0.5
"""Of the angle between the thrust and the reference's, beyond which nothing is planned: a tumble."""
ASTRAY = 3
"""How a search ends that has not begun, beside those of `plan`."""
DRAG = Parameters._fields.index("drag_x")


class Fallback(StrEnum):
    """Why the flatness controller's command was sent."""

    LATE = "late"
    NO_PROGRESS = "no progress"
    NOT_FINITE = "not finite"
    ASTRAY = "astray"


_REASONS = {NO_PROGRESS: Fallback.NO_PROGRESS, NOT_FINITE: Fallback.NOT_FINITE, ASTRAY: Fallback.ASTRAY}


@fused
def carried(off: Vector, grid: Vector, elapsed: float) -> None:
    """Shift the plan ``off`` (n, 4) by ``elapsed`` s, between the middles of its steps along straight lines."""
    n, j = off.shape[0], 0
    for k in range(n):
        now = grid[k, 4] + elapsed
        while j < n - 2 and grid[j + 1, 4] < now:
            j += 1
        share = min((now - grid[j, 4]) / (grid[j + 1, 4] - grid[j, 4]), 1.0)
        for i in range(INPUTS):
            off[k, i] = (1.0 - share) * off[j, i] + share * off[j + 1, i]


@lean_kernel
def carry_on(work: Work, elapsed: float) -> None:
    """Shift the plan by ``elapsed`` s."""
    carried(work.off, work.grid, elapsed)


@fused
def believe(m: Vector, believed: Vector, x: Vector, low: Vector, high: Vector) -> Parameters:
    """The vehicle as it is known by now into ``believed``, and as it is foreseen for the horizon's begin into ``x``.

    ``low`` and ``high`` get the bounds of its inputs. Thrusts are as the model has them, those sent are by the trim
    more.
    """
    for i in range(believed.shape[0]):
        believed[i] = m[at.PARAMETERS + i]
    for i in range(DRAG, DRAG + 3):
        believed[i] *= 1.0 + m[at.DRAG]
    for i in range(STATE):
        x[i] = m[at.FORESEEN + i]
    p = unpacked(believed)
    low[0] = low[1] = -p.rate_max
    high[0] = high[1] = p.rate_max
    low[2], high[2] = -p.yaw_rate_max, p.yaw_rate_max
    low[3], high[3] = p.thrust_min / (1.0 + m[at.TRIM]), p.thrust_max / (1.0 + m[at.TRIM])
    return p


@fused
def astray(x: Vector, r: Vector) -> bool:
    """Whether the thrust at ``x`` points so far away from that of the reference ``r`` that no slope shows the way."""
    return dot(axes((x[6], x[7], x[8], x[9]))[2], (r[6], r[7], r[8])) < ASTRAY_COSINE


@fused
def send(p: Parameters, m: Vector, u: Vector, low: Vector, high: Vector) -> float:
    """Put the input ``u`` in the place of the newest command; the specific force to send (m/s²)."""
    e = at.HISTORY + ((int(m[at.COUNT]) - 1) & at.MASK) * at.ENTRY + at.ENTRY_COMMAND
    free = 1.0
    for i in range(INPUTS):
        m[e + i] = u[i]
        if u[i] <= low[i] or u[i] >= high[i]:
            free = 0.0
    m[at.FREE] = free
    m[at.RATES], m[at.RATES + 1], m[at.RATES + 2] = u[0], u[1], u[2]
    return float(min(max(u[3] * (1.0 + m[at.TRIM]), p.thrust_min), p.thrust_max))


@fused_kernel
def mpc_command(m: Vector, work: Work, elapsed: float, iterations: int) -> tuple[int, float]:
    """A command in the place of that which `flatness_command` has just left in ``m``, ``elapsed`` s after the last.

    How the search ended (see `plan`), and the specific force to send (m/s²). Unless it has PLANNED, what was in ``m``
    stands.
    """
    low, high = work.bounds[0], work.bounds[1]
    p = believe(m, work.believed, work.x[0], low, high)
    carried(work.off, work.grid, elapsed)
    push = (m[at.DISTURBANCE], m[at.DISTURBANCE + 1], m[at.DISTURBANCE + 2])
    look_ahead(p, m, m[at.STAMP] + p.delay - m[at.ORIGIN], push, work)
    if astray(work.x[0], work.reference[1]):
        return ASTRAY, math.nan
    ended, u = plan(work, push, iterations), work.u[0]
    if not math.isfinite(u[0] + u[1] + u[2] + u[3]):
        ended = NOT_FINITE
    if ended != PLANNED:
        return ended, math.nan
    return ended, send(p, m, u, low, high)


class MpcController(FlatnessController):
    """Tracks a trajectory with planned body rates and thrust; see the module.

    It is a flatness controller, whose memory of commands and disturbances it shares, and whose command stands in where
    the search for a plan fails, and at a tick that comes late: that one takes a hundredth of the time.
    """

    def __init__(self, config: Config) -> None:
        self._period = 1.0 / config.control.rate
        self._last = math.nan
        self._ticks = 0
        self._fallbacks: Counter[Fallback] = Counter()
        self._prepare(config)
        super().__init__(config)
        # Compiled now, for the first tick that is late.
        self._carry_on(0.0)
        self._ticks = 0
        self._fallbacks.clear()

    @property
    def fallbacks(self) -> dict[str, int]:
        """Ticks at which the flatness controller's command was sent, by their reason, since this was made."""
        return {str(reason): count for reason, count in self._fallbacks.items()}

    @property
    def report(self) -> str:
        """How many commands were planned, and why others were not."""
        total = self._fallbacks.total()
        why = ", ".join(f"{reason} {count}" for reason, count in sorted(self._fallbacks.items()))
        return f"{self._ticks - total} of {self._ticks} commands planned" + (f"; by flatness: {why}" if why else "")

    def reset(self) -> None:
        """Forget the plan as well, at the start of a new flight."""
        super().reset()
        self._drop_plan()
        self._last = math.nan

    def command(self, stamp: float, state: VehicleState, trajectory: Trajectory) -> RateCommand:
        """As the flatness controller's, with its errors: what refuses its command leaves nothing to plan from."""
        simple = super().command(stamp, state, trajectory)
        elapsed, self._last = stamp - self._last, stamp
        self._ticks += 1
        if elapsed > LATE * self._period:
            self._fallbacks[Fallback.LATE] += 1
            self._carry_on(elapsed)
            return simple
        ended, thrust = self._search(0.0 if math.isnan(elapsed) else max(elapsed, 0.0))
        if ended != PLANNED:
            self._fallbacks[_REASONS[ended]] += 1
            self._drop_plan()
            return simple
        return RateCommand(stamp, self._memory[at.RATES : at.RATES + 3].copy(), thrust)

    def _prepare(self, config: Config) -> None:
        """Make room for a plan."""
        parameters = parameters_of(config)
        self._iterations = config.mpc.iterations
        self._work = room(parameters, steps_of(parameters, self._period, config.mpc.horizon))

    def _drop_plan(self) -> None:
        self._work.off[:] = 0.0

    def _carry_on(self, elapsed: float) -> None:
        """Let ``elapsed`` s of the plan go by without a search."""
        carry_on(self._work, elapsed)

    def _search(self, elapsed: float) -> tuple[int, float]:
        """Plan the command, ``elapsed`` s after the last; see `mpc_command`."""
        return mpc_command(self._memory, self._work, elapsed, self._iterations)
