"""What the planner is asked to achieve."""

from dataclasses import dataclass

from flightapp.frames import Vector
from flightapp.interfaces import Limits


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Fly through gates (or along waypoints) and come to rest at `end`."""

    end: Vector
    """(3,) m, world."""
    limits: Limits
    gate_ids: tuple[int, ...] = ()
    """In the order of passage; a gate that is flown through twice appears twice."""
    passed: int = 0
    """How many of them have been passed."""
    waypoints: Vector | None = None
    """(n, 3) m to fly through instead of gates."""
    serial: int = 0
    """Tells one goal from the next; the same while only `passed` changes."""
