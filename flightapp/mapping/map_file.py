"""Gate maps of earlier flights: a track file in which each gate stands where it was found, as well as it was found."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tomlkit

from flightapp.inputs import BadInputError
from flightapp.messages import GateEstimate
from flightapp.track import Gate, MarkedGate, Track, Uncertainty, load_track

DISC, INTERVAL = 2.0, math.sqrt(3.0)
"""Radius of a disc, and half of an interval, over the standard deviation of what is uniform in it."""


def mapped(track: Track, gates: Sequence[GateEstimate]) -> Track | None:
    """``track`` with its gates where ``gates`` have them; None where a gate's place is not known yet.

    The covariances are those in the world. What was never seen keeps what was known of it before.
    """
    places = {gate.gate_id: gate for gate in gates}
    if any(gate.id not in places for gate in track.passage):
        return None
    found = tuple(_gate(gate, places[gate.id]) for gate in track.passage)
    return track.model_copy(update={"gates": found, "unplaced": ()})


def _gate(gate: MarkedGate, place: GateEstimate) -> Gate:
    if place.sightings == 0 and isinstance(gate, Gate):
        return gate
    sigma = np.sqrt(np.diag(place.covariance))
    return Gate(
        id=gate.id,
        position=(float(place.position[0]), float(place.position[1]), float(place.position[2])),
        yaw_deg=math.degrees(place.yaw),
        markers=gate.markers,
        uncertainty=Uncertainty(
            horizontal=min(DISC * float(sigma[:2].max()), 20.0),
            vertical=min(INTERVAL * float(sigma[2]), 5.0),
            yaw_deg=min(math.degrees(INTERVAL * float(sigma[3])), 90.0),
        ),
    )


def write_map(path: Path, track: Track) -> None:
    """Write ``track`` as a track file."""
    data = track.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    path.write_text(f"# Gates as a flight has found them.\n{tomlkit.dumps(data)}", encoding="utf-8")


def read_map(path: Path, track: Track) -> Track:
    """``track`` with its gates as the map at ``path`` has them; raises `BadInputError` where it is of another track."""
    found = load_track(path)
    theirs = {gate.id: gate for gate in found.gates}
    for gate in track.passage:
        if gate.id not in theirs:
            raise BadInputError(f"{path}: gate {gate.id} of track '{track.name}' is not in this map")
        if theirs[gate.id].markers != gate.markers:
            raise BadInputError(
                f"{path}: gate {gate.id} has the markers {theirs[gate.id].markers}, but on track '{track.name}' it has"
                f" {gate.markers}; was it made on another track?"
            )
    gates = tuple(theirs[gate.id] for gate in track.passage)
    return track.model_copy(update={"gates": gates, "unplaced": (), "uncertainty": found.uncertainty})
