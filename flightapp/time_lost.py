"""What a flight lost on each leg against a line that was planned, knowing everything, for the whole track at once.

The line is a planner's, `race` or `optimal`, from rest at the start through all gates of all laps to rest at the end,
where the track's file has them, with the flight's own configuration: its speed and acceleration, and the shares of
thrust and body rate that plans may use. It is the least time that the planner finds under these, not the vehicle's; a
flight that cuts a bend within its tracking error can be faster on a leg.
"""

import tomllib

from flightapp.config import Config
from flightapp.evaluation.flight import Flight
from flightapp.evaluation.splits import Loss, Split, losses
from flightapp.evaluation.summary import Summary, flight_settings, flight_track
from flightapp.evaluation.tables import TextTable, number
from flightapp.inputs import BadInputError, validate
from flightapp.interfaces import PlanningError
from flightapp.plan_command import line_along


def time_lost(flight: Flight, summary: Summary, planner: str) -> tuple[Loss, ...]:
    """Each leg of ``flight`` beside the same leg of the line of ``planner``; plans it, which may take long.

    Raises `BadInputError` for a flight whose log does not tell its gates, and where there is no line.
    """
    flight_settings(flight)
    track = flight_track(flight)
    if track is None or not track.gates:
        raise BadInputError("time is lost from gate to gate, and the log tells of no gates whose places are known")
    source = "the config in the log's header"
    config = validate(Config, tomllib.loads(flight.header.get("config", "")), source)
    planning = config.planning.model_copy(update={"planner": planner})
    try:
        line = line_along(track, config.model_copy(update={"planning": planning}))
    except PlanningError as error:
        raise BadInputError(f"there is no line to compare with: {error}") from None
    legs = [Split(split["lap"], split["to"], split["time"]) for split in summary["splits"]]
    return losses(legs, line.gate_times, line.duration)


def loss_table(found: tuple[Loss, ...], planner: str) -> TextTable:
    """Each leg, and all that were flown together."""
    several = any(loss.lap > 1 for loss in found)
    rows = []
    for loss in found:
        name = f"{loss.to}, lap {loss.lap}" if several else loss.to
        rows.append([name, *(number(value, 3) for value in (loss.flown, loss.least, loss.lost))])
    whole = [loss for loss in found if loss.flown is not None]
    flown, least = sum(loss.flown or 0.0 for loss in whole), sum(loss.least for loss in whole)
    rows.append(["all that were flown", number(flown, 3), number(least, 3), number(flown - least, 3)])
    return TextTable(
        f"Time lost on each leg against planner {planner}", ("leg to", "flown s", "line s", "lost s"), rows
    )
