"""The judge of flights with faults: what is as stated passes, and what is not does not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flightapp.evaluation.fault_matrix import Cell, Seen, Stages, Statement, departure, matrix_json
from flightapp.messages import AutopilotStatus, FlightMode
from flightapp.safety.faults import FaultKind, Reaction, Stage

GROUND, TAKEOFF, OFFBOARD, LAND = FlightMode.HOLD, FlightMode.TAKEOFF, FlightMode.OFFBOARD, FlightMode.LAND
FINISH = np.array((9.0, 0.0, 1.0))
BEGIN = 8.0


def said(reaction, **changes):
    statement = Statement(
        FaultKind.POSE_LOST, Stage.FLYING, reaction, BEGIN, 0.5, math.inf, (1, 2), FINISH, False, 1.8, 3.0
    )
    return replace(statement, **changes)


def seen(*modes, speed=lambda t: 3.0, end=FINISH, passages=(1, 2), last_command=BEGIN, told=BEGIN + 0.3):
    """A flight of 20 s through ``modes`` (from s, mode), down and disarmed after 18 s if it lands."""
    stamps = np.arange(0.0, 20.0, 0.02)
    statuses, armed = [], False
    for t in np.arange(0.0, 20.0, 0.1):
        mode = [mode for begin, mode in modes if begin <= t + 1e-9][-1]
        armed = (armed or mode is TAKEOFF) and not (LAND in [m for _, m in modes] and t > 18.0)
        statuses.append(AutopilotStatus(float(t), mode, armed, False, True, 16.0, 1.0))
    flying = (stamps > 5.0) & (stamps < 18.0)
    position = np.zeros((stamps.size, 3))
    position[stamps > 5.0] = end
    position[~flying, 2] = 0.0
    speeds = np.where(flying, [speed(t) for t in stamps], 0.0)
    stages = Stages({Stage.PREFLIGHT: 0.0}, 20.0)
    commands = np.array([(last_command - 0.1, 3.0), (last_command, 1.0)])
    tilt = np.zeros(stamps.size)
    return Seen(stamps, position, speeds, tilt, statuses, passages, (), commands, {FaultKind.POSE_LOST: told}, stages)


UP = ((0.0, GROUND), (2.0, TAKEOFF), (5.0, OFFBOARD))
WHOLE = (*UP, (15.0, LAND))


@pytest.mark.parametrize(
    ("statement", "flight", "text"),
    [
        (said(Reaction.CONTINUE), seen(*WHOLE), ""),
        (said(Reaction.CONTINUE), seen(*WHOLE, passages=(1,)), "passed gates [1]"),
        (said(Reaction.CONTINUE), seen(*WHOLE, end=(4.0, 0.0, 1.0)), "5.0 m from the finish"),
        (said(Reaction.CONTINUE, pushed=True), seen(*WHOLE, end=(4.0, 0.0, 1.0)), ""),
        (said(Reaction.CONTINUE), seen(*UP), "not on the ground"),
        (said(Reaction.CONTINUE), seen(*WHOLE, told=7.0), "before it was there"),
        (said(Reaction.CONTINUE, kind=FaultKind.DISK_FULL), seen(*WHOLE), "was not noticed"),
        (said(Reaction.SLOW), seen(*WHOLE, speed=lambda t: 3.0 if t < 10.0 else 1.8), ""),
        (said(Reaction.SLOW), seen(*WHOLE), "still flies at 3.00 m/s"),
        (said(Reaction.HOLD, end=11.0), seen(*WHOLE, speed=lambda t: 0.0 if 9.5 < t < 11.0 else 3.0), ""),
        (said(Reaction.HOLD, end=11.0), seen(*WHOLE), "did not stop"),
        (said(Reaction.HOLD), seen(*UP, (12.0, LAND), speed=lambda t: 0.1), ""),
        (said(Reaction.HOLD), seen(*UP, (9.0, LAND), speed=lambda t: 0.1), "does not hover"),
        (said(Reaction.LAND), seen(*UP, (8.6, LAND)), ""),
        (said(Reaction.LAND), seen(*UP, (12.0, LAND)), "lands only 4.0 s later"),
        (said(Reaction.LAND), seen(*UP), "does not land"),
        (said(Reaction.LAND), seen(*UP, (8.6, LAND), (9.0, OFFBOARD)), "lands, then offboard"),
        (said(Reaction.REFUSE), seen((0.0, GROUND), end=(0.0, 0.0, 0.0)), ""),
        (said(Reaction.REFUSE), seen(*WHOLE), "was armed"),
        (said(Reaction.KILL), seen(*UP), "motors still turn"),
        (said(Reaction.HAND_BACK), seen(*UP, (8.0, FlightMode.POSITION), (10.0, LAND)), ""),
        (said(Reaction.HAND_BACK), seen(*UP, (8.0, FlightMode.POSITION), (8.5, LAND), (9.0, OFFBOARD)), "offboard"),
        (said(Reaction.HAND_BACK), seen(*UP, (8.0, FlightMode.POSITION), (10.0, LAND), last_command=9.0), "commands"),
    ],
)
def test_only_what_is_as_stated_passes(statement, flight, text):
    found = departure(statement, flight)
    assert text in found
    assert bool(text) == bool(found)


def test_a_cell_counts_and_says_what_was_otherwise():
    cell = Cell(FaultKind.POSE_LOST, Stage.FLYING, Reaction.LAND)
    cell.add(0, "", "")
    assert cell.good
    cell.add(1, "does not land", "hit ground")
    assert not cell.good
    (row,) = matrix_json([cell])["rows"]
    assert {key: row[key] for key in ("fault", "phase", "reaction", "runs", "as_stated", "crashes")} == {
        "fault": "pose lost",
        "phase": "flying",
        "reaction": "land",
        "runs": 2,
        "as_stated": 1,
        "crashes": 1,
    }
    assert row["ci95"][0] < 0.5 < row["ci95"][1]
    assert row["departures"] == [{"seed": 1, "why": "does not land; hit ground"}]
