"""The topics that tasks and behaviors share."""

from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.messages import (
    Event,
    Frame,
    GateMap,
    Phase,
    PlanReport,
    PoseSample,
    ProcessLoad,
    RateCommand,
    Setpoint,
    Sightings,
    StageTime,
    VehicleState,
)
from flightapp.planning.goal import Goal
from flightapp.safety.faults import Fault
from flightapp.trajectory import Trajectory


class Bus:
    """Every topic of the application, by name; the autopilot's status is the autopilot's own."""

    def __init__(self) -> None:
        self.frame: Topic[Frame] = Topic("frame")
        self.sightings: Topic[Sightings] = Topic("sightings")
        self.pose: Topic[PoseSample] = Topic("pose")
        self.state: Topic[VehicleState] = Topic("state")
        self.gate_map: Topic[GateMap] = Topic("gate_map")
        self.goal: Topic[Goal | None] = Topic("goal")
        """None: nothing is to be reached, and the line is flown to its end."""
        self.trajectory: Topic[Trajectory] = Topic("trajectory")
        self.plan: Topic[PlanReport] = Topic("plan")
        self.setpoint: Topic[Setpoint] = Topic("setpoint")
        self.command: Topic[RateCommand] = Topic("command")
        self.phase: Topic[Phase] = Topic("phase")
        self.stage: Topic[StageTime] = Topic("stage")
        self.behaviors: Topic[tuple[str, ...]] = Topic("behaviors")
        """The names of those at work."""
        self.tick: Topic[float] = Topic("tick")
        """Each turn of the sender, whether it had something to send or not."""
        self.config: Topic[Config] = Topic("config")
        """What is flown with; another where gains were changed."""
        self.load: Topic[ProcessLoad] = Topic("load")
        self.event: Topic[Event] = Topic("event")
        self.fault: Topic[Fault] = Topic("fault")
