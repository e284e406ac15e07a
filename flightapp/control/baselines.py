"""Controllers to compare with: the law of `flatness` with fewer of its terms, on the same vehicle and gains.

`PaperController` is that of D. Mellinger and V. Kumar, "Minimum snap trajectory generation and control for
quadrotors" (2011), with body rates and collective thrust for outputs as in "Framework and Evaluation Methodology for
Autonomous Drone Racing": feedback of position and velocity, acceleration and the body rates that jerk asks for fed
forward. `PdController` is what won races in 2019: position and velocity errors ask for a tilt, and the tilt's error for
body rates, with nothing known of the trajectory's derivatives but its velocity (C. De Wagter et al., "The artificial
intelligence behind the winning entry to the 2019 AI robotic racing competition", 2021).
"""

from typing import ClassVar

from flightapp.config import Term
from flightapp.control.flatness import FlatnessController

ADDITIONS: tuple[Term, ...] = (
    "snap",
    "drag",
    "prediction",
    "rate_lead",
    "thrust_lead",
    "error_rate",
    "disturbance",
    "drift",
)
"""What neither has."""


class PaperController(FlatnessController):
    """Position, velocity, acceleration and jerk; no model of drag, delay, lags or disturbances."""

    WITHOUT: ClassVar[tuple[Term, ...]] = ADDITIONS


class PdController(FlatnessController):
    """Position and velocity, nothing else."""

    WITHOUT: ClassVar[tuple[Term, ...]] = ("acceleration", "jerk", *ADDITIONS)
