"""The simulated vehicle behind one object: commands in, motion out, and a short memory of it."""

import math
from collections.abc import Sequence
from struct import Struct

import numpy as np

from flightapp.frames import Vector, quat_from_yaw, quat_multiply
from sim import layout as at
from sim.dynamics import advance, interpolate
from sim.vehicles import FOOT_SAG, VehicleParameters

MEMORY = 2048
"""Trace rows that are always kept."""
_COMMAND = Struct(f"{at.QUEUE_COLUMNS}d")
_QUEUE = 8 * at.QUEUE
"""Where the ring of commands begins, in bytes."""


class Plant:
    """A vehicle with its rate loop in the wind, advanced in whole steps.

    It starts at rest at ``position`` (3,) m, facing ``yaw``; on the ground (z ≤ 0) it stands on its feet, and in the
    air it falls until it is commanded. ``wind`` and ``gust`` are the mean speed and the standard deviation of the
    gusts in m/s; the mean wind's direction and the gusts follow from ``seed``. ``start`` is the time it starts at.
    """

    def __init__(
        self,
        vehicle: VehicleParameters,
        seed: int,
        step: float = 0.001,
        wind: float = 0.0,
        gust: float = 0.0,
        position: Sequence[float] | Vector = (0.0, 0.0, 0.0),
        yaw: float = 0.0,
        start: float = 0.0,
    ) -> None:
        self.vehicle = vehicle
        self._rng = np.random.default_rng([seed, 0x9A1])
        bearing = self._rng.uniform(0.0, 2.0 * np.pi)
        self.mean_wind = wind * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        self._start, self._step, self._rate, self._count = start, step, 1.0 / step, 0
        self._allocate(2 * MEMORY)
        self._constants[:] = vehicle.constants(step, start, self.mean_wind, gust)
        self._state[:] = self._initial_state(position, yaw)
        # Only gusts use noise up.
        self._noise_left = 0.0 if gust > 0.0 else math.inf
        self._tail = self._seen_head = 0
        self._history[0, 0] = start
        self._history[0, 1:] = self._state[: at.ROTORS]
        self._first = self._filled = 1

    def _allocate(self, rows: int) -> None:
        """Make a memory with room for ``rows`` of history."""
        memory = self._memory = np.zeros(at.HISTORY + rows * at.TRACE)
        self._state = memory[: at.STATE_SIZE]
        self._constants = memory[at.CONSTANTS : at.NOISE]
        self._noise = memory[at.NOISE : at.HISTORY].reshape(-1, 3)
        self._history = memory[at.HISTORY :].reshape(-1, at.TRACE)
        # Single numbers are read and written much faster through a memoryview.
        self._bytes = memoryview(memory.data).cast("B")
        self._cells = self._bytes.cast("d")
        self._capacity = rows

    def _initial_state(self, position: Sequence[float] | Vector, yaw: float) -> Vector:
        S = np.zeros(at.STATE_SIZE)
        S[0:3] = position
        if S[2] <= 0.0:
            S[2] = -FOOT_SAG
            S[at.CONTACT] = 1.0
        S[at.ORIENTATION : at.VELOCITY] = quat_from_yaw(yaw)
        S[at.CHARGE] = 1.0
        S[at.VOLTAGE] = self.vehicle.battery.cells * self.vehicle.battery.open_circuit[-1]
        S[at.PHASE] = self._constants[at.P_LOOP_PERIOD]
        gust = self._constants[at.P_GUST]
        S[at.GUST : at.GUST + 2] = gust * self._rng.standard_normal(2)
        return S

    @property
    def memory(self) -> Vector:
        """All of the vehicle's numbers, packed as `layout` says, for kernels that fly it themselves."""
        return self._memory

    @property
    def time(self) -> float:
        """The moment of the newest state, s."""
        return self._start + self._count * self._step

    def advance(self, until: float, extend: bool = False) -> None:
        """Make the whole steps up to ``until``; ``extend`` adds them to the last call's `trace`."""
        target = int((until - self._start) * self._rate + 1e-6)
        steps = target - self._count
        if not extend:
            self._first = self._filled
        if steps <= 0:
            return
        if self._filled + steps > self._capacity:
            self._make_room(steps)
        if self._noise_left < steps:
            self._advance_in_gusts(steps)
        else:
            advance(self._memory, self._filled, steps)
            self._noise_left -= steps
        self._filled += steps
        self._count = target

    def _advance_in_gusts(self, steps: int) -> None:
        """The steps for which there is not enough noise left."""
        row = self._filled
        while steps > 0:
            if self._noise_left <= 0.0:
                self._noise[:] = self._rng.standard_normal(self._noise.shape)
                self._noise_left = at.NOISE_ROWS
                self._state[at.NOISE_ROW] = 0.0
            n = min(steps, int(self._noise_left))
            advance(self._memory, row, n)
            self._noise_left -= n
            row += n
            steps -= n

    def _make_room(self, steps: int) -> None:
        oldest = max(min(self._filled - MEMORY, self._first), 0)
        kept = self._history[oldest : self._filled].copy()
        needed = len(kept) + steps
        if needed > self._capacity:
            before = self._memory
            self._allocate(needed + MEMORY)
            self._memory[: at.HISTORY] = before[: at.HISTORY]
        self._history[: len(kept)] = kept
        self._filled = len(kept)
        self._first -= oldest

    @property
    def trace(self) -> Vector:
        """(n, 17) the rows that the last `advance` made, valid until the next: see `layout.TRACE`."""
        return self._history[self._first : self._filled]

    def state_at(self, time: float) -> Vector:
        """(17,) trace row at ``time``, interpolated; raises `ValueError` outside the last two seconds."""
        place = self._filled - 1 + (time - self.time) / self._step
        if not -1e-6 <= place < self._filled:
            raise ValueError(f"no state is kept for t = {time} s; the newest is for {self.time} s")
        row = np.empty(at.TRACE)
        interpolate(self._memory, min(max(place, 0.0), self._filled - 1.0), self._filled - 1, row)
        return row

    def command(self, effective_time: float, rates_flu: Sequence[float] | Vector, thrust01: float) -> None:
        """From ``effective_time`` on, hold the body rates (3,) rad/s, FLU, at ``thrust01`` 0..1; motors turn.

        Commands that are still pending take effect in the order in which they were given.
        """
        tail = self._tail
        if tail - self._seen_head >= at.QUEUE_ROWS:
            self._find_room()
        p, q, r = rates_flu
        throttle = 0.0 if thrust01 < 0.0 else 1.0 if thrust01 > 1.0 else thrust01
        place = _QUEUE + tail % at.QUEUE_ROWS * _COMMAND.size
        _COMMAND.pack_into(self._bytes, place, effective_time, p, q, r, throttle)
        self._tail = tail + 1
        self._cells[at.QUEUE_TAIL] = tail + 1.0

    def _find_room(self) -> None:
        self._seen_head = int(self._cells[at.QUEUE_HEAD])
        if self._tail - self._seen_head >= at.QUEUE_ROWS:
            raise RuntimeError(f"more than {at.QUEUE_ROWS} commands are pending")

    def drop_pending(self) -> None:
        """Forget the commands that have not taken effect yet."""
        self._cells[at.QUEUE_HEAD] = self._cells[at.QUEUE_TAIL]

    def stop_motors(self) -> None:
        """Let the rotors run out and forget pending commands."""
        self.drop_pending()
        S = self._state
        S[at.MOTORS_ON] = 0.0
        S[at.SIGNALS : at.SIGNALS + 4] = 0.0
        S[at.RATES : at.THRUST + 1] = 0.0

    @property
    def position(self) -> Vector:
        """(3,) m, world."""
        return self._state[0:3].copy()

    @property
    def orientation(self) -> Vector:
        """(4,) q_wb."""
        return self._state[at.ORIENTATION : at.VELOCITY].copy()

    @property
    def velocity(self) -> Vector:
        """(3,) m/s, world."""
        return self._state[at.VELOCITY : at.OMEGA].copy()

    @property
    def angular_velocity(self) -> Vector:
        """(3,) rad/s, body."""
        return self._state[at.OMEGA : at.FORCE].copy()

    @property
    def specific_force(self) -> Vector:
        """(3,) m/s², body."""
        return self._state[at.FORCE : at.ROTORS].copy()

    @property
    def rotor_speeds(self) -> Vector:
        """(4,) rad/s, in PX4's order."""
        return self._state[at.ROTORS : at.ROTORS + 4].copy()

    @property
    def wind(self) -> Vector:
        """(3,) m/s, world: mean and gust."""
        return self.mean_wind + self._state[at.GUST : at.GUST + 3]

    @property
    def on_ground(self) -> bool:
        """Whether it touches the ground."""
        return self._cells[at.CONTACT] != 0.0

    @property
    def voltage(self) -> float:
        """V, of the battery under load."""
        return self._cells[at.VOLTAGE]

    @property
    def charge(self) -> float:
        """0..1, left in the battery."""
        return self._cells[at.CHARGE]

    @charge.setter
    def charge(self, share: float) -> None:
        self._cells[at.CHARGE] = share

    # What somebody does to it.

    def blow(self, wind: Vector) -> None:
        """From now on there is the ``wind`` (3,) m/s, world, besides mean wind and gusts."""
        self._constants[at.P_WIND : at.P_WIND + 3] = self.mean_wind + wind

    def tip(self, upright: Vector, angle: float, rate: float) -> None:
        """Hold it, turned from its attitude ``upright`` (4,) by ``angle`` rad about x, as high as its feet need.

        ``rate`` rad/s is how fast it is being turned.
        """
        S = self._state
        turned = np.array((math.cos(0.5 * angle), math.sin(0.5 * angle), 0.0, 0.0))
        S[at.ORIENTATION : at.VELOCITY] = quat_multiply(upright, turned)
        S[2] = max(S[2], self._constants[at.P_ROTOR_Y] * abs(math.sin(angle)) - FOOT_SAG)
        S[at.VELOCITY : at.OMEGA + 3] = 0.0
        S[at.OMEGA] = rate
