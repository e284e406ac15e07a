"""The line being flown: the current trajectory and those that take over from it, each at its stamp."""

import math

from flightapp.interfaces import Motion, PlanningError
from flightapp.planning.splice import splice_fault
from flightapp.trajectory import Trajectory


class SpliceError(PlanningError):
    """A trajectory can't be flown on from the line; the text says why."""


class Line:
    """Holds the trajectory to follow; a successor takes over exactly at its own start, without a jump.

    Whatever is accepted ends at rest, so that a line on which nothing follows ends in a hover.
    """

    def __init__(self) -> None:
        self._pieces: list[Trajectory] = []
        self._followed = -math.inf

    def clear(self) -> None:
        """Follow nothing."""
        self._pieces = []
        self._followed = -math.inf

    def accept(self, trajectory: Trajectory) -> None:
        """Follow ``trajectory`` from its stamp on, in place of all that was to begin then or later.

        Raises `SpliceError`, and changes nothing, where the motion would jump or would not end at rest. A line that
        is empty may begin anywhere.
        """
        if trajectory.stamp < self._followed:
            late = self._followed - trajectory.stamp
            raise SpliceError(f"late by {late:.3f} s")
        motion = self.motion(trajectory.stamp) if self._pieces else None
        if fault := splice_fault(trajectory, motion):
            raise SpliceError(fault)
        self._pieces = [piece for piece in self._pieces if piece.stamp < trajectory.stamp]
        self._pieces.append(trajectory)

    def at(self, stamp: float) -> Trajectory | None:
        """The trajectory to follow at ``stamp``, which must not run backwards."""
        if not self._pieces:
            return None
        self._followed = stamp
        while len(self._pieces) > 1 and stamp >= self._pieces[1].stamp:
            del self._pieces[0]
        return self._pieces[0]

    @property
    def latest(self) -> Trajectory | None:
        """The trajectory that was accepted last."""
        return self._pieces[-1] if self._pieces else None

    def at_rest(self, stamp: float) -> bool:
        """Whether all motion is over at ``stamp``, the heading's too."""
        if not self._pieces:
            return False
        last = self._pieces[-1]
        return stamp >= last.stamp + max(last.duration, float(last.yaw_knots[-1]))

    def motion(self, stamp: float) -> Motion:
        """The reference motion at a ``stamp`` not before now; `accept` must have been called."""
        if not self._pieces:
            raise LookupError("there is no line to take a motion from")
        begun = [piece for piece in self._pieces if piece.stamp <= stamp]
        s = (begun[-1] if begun else self._pieces[0]).setpoint(stamp)
        return Motion(s.position, s.velocity, s.acceleration, s.jerk, s.yaw, s.yaw_rate)
