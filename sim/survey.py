"""What is known of a track before the flight: its gates, each off by as much as the track says."""

import math

import numpy as np

from flightapp.inputs import BadInputError
from flightapp.messages import GateEstimate
from flightapp.track import Track, Uncertainty


def survey(track: Track, rng: np.random.Generator, exact: bool) -> Track:
    """``track`` with each gate displaced by a draw from its uncertainty, or ``exact`` and said to be so.

    The position is drawn uniformly from the horizontal disc, the height and the yaw uniformly from their
    intervals; a gate is kept above the ground.
    """
    if exact:
        gates = tuple(gate.model_copy(update={"uncertainty": None}) for gate in track.gates)
        return track.model_copy(update={"gates": gates, "uncertainty": Uncertainty()})
    moved_gates = []
    for gate in track.gates:
        u = gate.uncertainty or track.uncertainty
        radius = u.horizontal * math.sqrt(rng.uniform())
        angle = rng.uniform(-math.pi, math.pi)
        x, y, z = gate.position
        moved = (
            x + radius * math.cos(angle),
            y + radius * math.sin(angle),
            max(z + rng.uniform(-1.0, 1.0) * u.vertical, 0.5 * track.gate.opening),
        )
        yaw = gate.yaw_deg + rng.uniform(-1.0, 1.0) * u.yaw_deg
        moved_gates.append(gate.model_copy(update={"position": moved, "yaw_deg": yaw}))
    return track.model_copy(update={"gates": tuple(moved_gates)})


def true_gates(track: Track) -> tuple[GateEstimate, ...]:
    """Where the gates of ``track`` really are; raises `BadInputError` where the track doesn't say."""
    if track.unplaced:
        raise BadInputError(f"track '{track.name}' does not say where its gates are, but a simulated world must know")
    return tuple(
        GateEstimate(gate.id, np.array(gate.position), gate.yaw, np.zeros((4, 4)), 0, -math.inf) for gate in track.gates
    )
