"""What an application and its simulated world in another process say to each other over their pipe."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from flightapp.config import Config
from flightapp.messages import Collision, GatePassage, GroundTruth
from flightapp.track import Track


@dataclass(frozen=True, slots=True)
class Order:
    """What is to be simulated."""

    config: Config
    track: Track
    seed: int
    origin: float
    """CLOCK_MONOTONIC, s, when the application's clock showed 0."""
    remote: tuple[str, int]
    """Where the application listens for MAVLink."""


class Ask(StrEnum):
    """What may be asked of the world."""

    STATE = "state"
    STATISTICS = "statistics"
    FAULT = "fault"
    STOP = "stop"


@dataclass(frozen=True, slots=True)
class Answer:
    """What the world says to a request, and to the order at its start."""

    content: Any = None
    refusal: str = ""
    """Why the request was refused: what the user can mend."""


@dataclass(frozen=True, slots=True)
class WorldState:
    """How things really are."""

    motion: GroundTruth
    mode: str
    """PX4's name of the mode it is in."""
    armed: bool
    landed: bool
    verdicts: tuple[GatePassage | Collision, ...]
    """The referee's, all of them so far."""


@dataclass(frozen=True, slots=True)
class Lines:
    """The ends of the lines to the application, as file descriptors."""

    control: int
    poses: int
    frames: int
    truth: int
    memory: int

    def descriptors(self) -> list[int]:
        """All of them, in this order."""
        return [self.control, self.poses, self.frames, self.truth, self.memory]
