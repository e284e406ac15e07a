"""Trajectory tracking by model-predictive contouring control: the line is a path, and its time a thing to be planned.

At every tick the inputs of the next moments and the rate of the progress along the line are planned together: forward
as fast as the rate's bounds allow, near the line, nearest in the gates. Where the vehicle cannot follow, the progress
waits for it, so that it comes late rather than off the line; where there is thrust left, it runs ahead. After A. Romero
et al., "Model predictive contouring control for time-optimal quadrotor flight" (2022); see `mpcc_cost`.

What is told to others stays the planner's: a line keeps its shape and its time. The controller moves the line's origin
in its own memory, by at most a bound in seconds and half of `safety.tracking_error`, so that whoever compares the
vehicle with the line by time finds it on it; nowhere is the line flown along faster than at its own greatest speed.
"""

import math

import numpy as np

from flightapp.config import Config
from flightapp.control import layout as at
from flightapp.control.mpc import ASTRAY, MpcController, astray, believe, carried, send
from flightapp.control.mpc_solver import NOT_FINITE, PLANNED
from flightapp.control.mpc_work import steps_of
from flightapp.control.mpcc_horizon import SLOWEST, look_along, top_speed
from flightapp.control.mpcc_solver import RATE, plan
from flightapp.control.mpcc_work import PROGRESS, Contour, ContourWork, contour_of, room
from flightapp.control.parameters import parameters_of
from flightapp.frames import Vector
from flightapp.jit import fused, fused_kernel, lean_kernel
from flightapp.messages import RateCommand, VehicleState
from flightapp.trajectory import Trajectory

REACH = 0.6
"""Share of `safety.tracking_error` that the progress may be off the line's own time."""

MEETS = 0.05
"""m between the ends of two lines of which one goes on from the other."""


@fused
def _rate_at(rates: Vector, grid: Vector, k: int, t: float) -> float:
    """The rate ``t`` s after the horizon's begin, in its ``k``-th step; the last one's end goes on for ever."""
    begin = grid[k, 4] - 0.5 * grid[k, 0]
    share = min((t - begin) / grid[k, 0], 1.0)
    return float(rates[k] + share * (rates[k + 1] - rates[k]))


@lean_kernel
def gained(rates: Vector, grid: Vector, elapsed: float) -> float:
    """s that the progress gains in the ``elapsed`` s after the horizon's begin, over the line's own time."""
    n, total, now = grid.shape[0], 0.0, 0.0
    for k in range(n):
        end = min(elapsed, grid[k, 4] + 0.5 * grid[k, 0])
        if end <= now:
            return total
        total += (end - now) * (_rate_at(rates, grid, k, 0.5 * (now + end)) - 1.0)
        now = end
    return float(total + (elapsed - now) * (rates[n] - 1.0))


@fused
def _shift(work: ContourWork, elapsed: float) -> None:
    rates, grid, n, k = work.rates, work.grid, work.grid.shape[0], 0
    for i in range(n + 1):
        work.spare[i] = rates[i]
    for i in range(n + 1):
        t = elapsed if i == 0 else elapsed + grid[i - 1, 4] + 0.5 * grid[i - 1, 0]
        while k < n - 1 and grid[k, 4] + 0.5 * grid[k, 0] < t:
            k += 1
        rates[i] = _rate_at(work.spare, grid, k, t)


@lean_kernel
def carry_on(work: ContourWork, elapsed: float) -> None:
    """Shift the plan by ``elapsed`` s."""
    carried(work.off, work.grid, elapsed)
    _shift(work, elapsed)


@fused_kernel
def mpcc_command(m: Vector, work: ContourWork, lead: float, elapsed: float, iterations: int) -> tuple[int, float]:
    """As `mpc_command`, along the line in ``m``, which is flown ``lead`` s ahead of its own time."""
    low, high, x = work.bounds[0, 0], work.bounds[0, 1], work.x[0]
    p = believe(m, work.believed, x[PROGRESS:], low, high)
    for k in range(1, work.bounds.shape[0]):
        for i in range(RATE):
            work.bounds[k, 0, i], work.bounds[k, 1, i] = low[i], high[i]
    carried(work.off, work.grid, elapsed)
    _shift(work, elapsed)
    push = (m[at.DISTURBANCE], m[at.DISTURBANCE + 1], m[at.DISTURBANCE + 2])
    x[0], x[1] = m[at.STAMP] + p.delay - m[at.ORIGIN], work.rates[0]
    look_along(p, m, x[0], lead, push, work)
    if astray(x[PROGRESS:], work.reference[1]):
        return ASTRAY, math.nan
    ended, u = plan(work, push, iterations), work.u[0]
    total = u[0] + u[1] + u[2] + u[3]
    for k in range(work.rates.shape[0]):
        total += work.rates[k]
    if not math.isfinite(total):
        ended = NOT_FINITE
    if ended != PLANNED:
        return ended, math.nan
    return ended, send(p, m, u, low, high)


def _goes_on(line: Trajectory, following: Trajectory) -> bool:
    """Whether ``following`` begins where ``line`` is at that moment."""
    stamp = following.stamp
    off = line.setpoint(stamp).position - following.setpoint(stamp).position
    return float(off @ off) < MEETS * MEETS


class MpccController(MpcController):
    """Flies along a trajectory; see the module. The flatness controller stands by, at the progress that was made."""

    def __init__(self, config: Config) -> None:
        self._room: ContourWork
        self._lead = self._ahead = self._now = 0.0
        self._begun = False
        self._coming: list[Trajectory] = []
        super().__init__(config)

    @property
    def lead(self) -> float:
        """s by which the progress is ahead of the line's own time."""
        return self._ahead

    def reset(self) -> None:
        """Forget the progress as well, at the start of a new flight."""
        super().reset()
        self._lead = self._ahead = 0.0
        self._begun = False
        self._coming.clear()

    def retune(self, config: Config) -> None:
        """As the flatness controller's, with the weights that follow from the gains."""
        super().retune(config)
        self._room.contour[:] = self._contour(config)

    def command(self, stamp: float, state: VehicleState, trajectory: Trajectory) -> RateCommand:
        """As the flatness controller's, with its errors.

        A ``trajectory`` that goes on from the one before takes over when the progress has come to its start.
        """
        elapsed = 0.0 if math.isnan(self._last) else max(stamp - self._last, 0.0)
        self._ahead = self._lead + gained(self._room.rates, self._room.grid, elapsed)
        self._now = stamp + self._parameters.delay
        self._memory[at.ORIGIN] = self._trajectory.stamp - self._ahead
        return super().command(stamp, state, self._due(trajectory))

    def _due(self, newest: Trajectory) -> Trajectory:
        """The trajectory to follow: the last of those up to the ``newest`` that the progress has come to."""
        line = self._trajectory if self._coming or self._begun else newest
        self._begun = True
        if newest is not (self._coming[-1] if self._coming else line):
            self._coming.append(newest)
        while self._coming:
            following = self._coming[0]
            if self._now + self._ahead < following.stamp and _goes_on(line, following):
                break
            line = self._coming.pop(0)
        return line

    def _load(self, trajectory: Trajectory) -> None:
        """Take over a new trajectory, and the lead with it where that goes on from the one before, in motion."""
        goes_on = self._begun and _goes_on(self._trajectory, trajectory)
        super()._load(trajectory)
        m, begin = self._memory, trajectory.setpoint(trajectory.stamp)
        late = self._ahead < 0.0 and goes_on
        if not late and not (goes_on and float(np.linalg.norm(begin.velocity)) > SLOWEST):
            self._ahead = 0.0
        m[at.ORIGIN] = trajectory.stamp - self._ahead
        self._room = self._room._replace(line=np.array((top_speed(m), *trajectory.gate_times), float))

    def _prepare(self, config: Config) -> None:
        parameters, settings = parameters_of(config), config.mpcc
        self._iterations = settings.iterations
        grid = steps_of(parameters, self._period, settings.horizon)
        self._room = room(parameters, self._contour(config), grid)

    def _contour(self, config: Config) -> Contour:
        kp = parameters_of(config).kp_xy
        return contour_of(config.mpcc, kp, REACH * config.safety.tracking_error)

    def _drop_plan(self) -> None:
        self._room.off[:] = 0.0
        self._room.rates[:] = 1.0
        self._lead = self._ahead

    def _carry_on(self, elapsed: float) -> None:
        carry_on(self._room, elapsed)
        self._lead = self._ahead

    def _search(self, elapsed: float) -> tuple[int, float]:
        self._lead = self._ahead
        return mpcc_command(self._memory, self._room, self._ahead, elapsed, self._iterations)
