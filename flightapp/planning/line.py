"""The line being flown: the current trajectory and the one that takes over from it at its stamp."""

from flightapp.interfaces import Motion
from flightapp.trajectory import Trajectory


class Line:
    """Holds the trajectory to follow; a successor takes over exactly at its own start."""

    def __init__(self) -> None:
        self._current: Trajectory | None = None
        self._next: Trajectory | None = None

    def clear(self) -> None:
        """Follow nothing."""
        self._current = self._next = None

    def accept(self, trajectory: Trajectory) -> None:
        """Follow ``trajectory`` from its stamp on."""
        if self._current is None:
            self._current = trajectory
        else:
            if self._next is not None and self._next.stamp <= trajectory.stamp:
                self._current = self._next
            self._next = trajectory

    def at(self, stamp: float) -> Trajectory | None:
        """The trajectory to follow at ``stamp``, which must not run backwards."""
        if self._next is not None and stamp >= self._next.stamp:
            self._current, self._next = self._next, None
        return self._current

    @property
    def latest(self) -> Trajectory | None:
        """The trajectory that was accepted last."""
        return self._next or self._current

    def motion(self, stamp: float) -> Motion:
        """The reference motion at a ``stamp`` not before now; `accept` must have been called."""
        if self._next is not None and stamp >= self._next.stamp:
            trajectory = self._next
        elif self._current is not None:
            trajectory = self._current
        else:
            raise LookupError("there is no line to take a motion from")
        s = trajectory.setpoint(stamp)
        return Motion(s.position, s.velocity, s.acceleration, s.jerk, s.yaw, s.yaw_rate)
