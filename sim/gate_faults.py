"""How the gates really stand where sim.faults moves them."""

import math
from collections.abc import Sequence

from flightapp.inputs import BadInputError
from flightapp.track import Track
from sim.faults import Fault


def rearranged(track: Track, faults: Sequence[Fault]) -> tuple[tuple[float, Track], ...]:
    """How the gates of ``track`` really stand from which time on, the first at the start.

    Raises `BadInputError` for a gate that the track does not have.
    """
    now, later = track, []
    for fault in faults:
        if fault.name not in ("gate_missing", "gate_moved", "gates_swapped"):
            continue
        now = _rearranged(now, fault)
        if fault.begin <= 0.0:
            track = now
        else:
            later.append((fault.begin, now))
    return (0.0, track), *later


def _rearranged(track: Track, fault: Fault) -> Track:
    gates = {gate.id: gate for gate in track.gates}
    named = fault.amount if fault.name == "gates_swapped" else fault.amount[:1]
    for gate_id in named:
        if gate_id not in gates:
            raise BadInputError(f"fault '{fault.name}': the track has no gate {gate_id:g}")
    first = gates[int(named[0])]
    if fault.name == "gate_missing":
        del gates[first.id]
    elif fault.name == "gate_moved":
        (x, y, z), way = first.position, fault.amount[1]
        place = (x - way * math.sin(first.yaw), y + way * math.cos(first.yaw), z)
        gates[first.id] = first.model_copy(update={"position": place})
    else:
        second = gates[int(named[1])]
        for gate, other in ((first, second), (second, first)):
            gates[gate.id] = gate.model_copy(update={"position": other.position, "yaw_deg": other.yaw_deg})
    return track.model_copy(update={"gates": tuple(gates.values())})
