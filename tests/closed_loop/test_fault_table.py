"""Rows of the fault table as `flightapp faults` provokes them, one seed each; judged by the truth.

A selection that has each reaction in each phase in which there is one; the command flies all of them.
"""

from pathlib import Path

import pytest

from flightapp import app, fault_command
from flightapp.safety.faults import FaultKind, Stage

MISSION = Path(__file__).parents[2] / "missions" / "faults.py"
SEED = 7300
PREFLIGHT, TAKEOFF, FLYING, LANDING = Stage
ROWS = [
    (FaultKind.POSE_LOST, PREFLIGHT),
    (FaultKind.STATE_UNTRUSTED, TAKEOFF),
    (FaultKind.POSE_MISSING, FLYING),
    (FaultKind.POSE_LOST, FLYING),
    (FaultKind.STATE_UNTRUSTED, FLYING),
    (FaultKind.CAMERA_LOST, FLYING),
    (FaultKind.PLANNER_FAILING, FLYING),
    (FaultKind.BATTERY_LOW, FLYING),
    (FaultKind.LINK_LOST, TAKEOFF),
    (FaultKind.LINK_LOST, FLYING),
    (FaultKind.TAKEN_OVER, FLYING),
    (FaultKind.TASK_FAILED, FLYING),
    (FaultKind.TAKEN_OVER, LANDING),
    (FaultKind.TIPPED_OVER, LANDING),
    (FaultKind.LOG_FAILING, FLYING),
    (FaultKind.TASK_FAILED, LANDING),
    (FaultKind.NO_COMMAND, FLYING),
]


@pytest.fixture(scope="module")
def flights():
    """The plan of all flights, and when the stages of one without faults begin."""
    plan = app.FlightPlan(MISSION, Path(), overrides=fault_command.SETTINGS)
    return plan, fault_command.fly_without(plan, SEED)


@pytest.mark.parametrize(("kind", "stage"), ROWS, ids=lambda value: value.replace(" ", "_"))
def test_what_happens_is_what_is_stated(flights, kind, stage):
    plan, stages = flights
    outcome = fault_command.fly_with_fault(plan, fault_command.Job(kind, stage, SEED, stages))
    assert outcome.departure == ""
    assert outcome.crash == ""
