"""How long it takes from a measurement to the command that heeds it, stage by stage.

| stage              | from                                          | to                                        |
| ------------------ | --------------------------------------------- | ----------------------------------------- |
| camera             | middle of the exposure                        | detection sets to work on the frame       |
| detection          | there                                         | its sightings are there                   |
| estimate           | there                                         | the gate map that heeds them              |
| plan               | a plan is asked for                           | its line is flown                         |
| state              | a pose's capture                              | the tick that steers by it                |
| command            | that tick                                     | its command is handed to the autopilot    |
| camera to command  | middle of the exposure of a frame with gates  | the first command after the map heeds it  |
| pose to command    | a pose's capture                              | its command is handed to the autopilot    |

On the wall clock these are what the computer took, waiting included. In virtual time a computation takes what the
section `compute` of the configuration says, and a command none: there the numbers show the sensors' latencies, the
waiting for ticks and frames, and that preset, not this computer.
"""

from dataclasses import dataclass

import numpy as np

from flightapp.evaluation.flight import Flight
from flightapp.evaluation.metrics import Window
from flightapp.frames import Vector
from flightapp.messages import Stage

STAGES = ("camera", "detection", "estimate", "plan", "state", "command", "camera to command", "pose to command")


@dataclass(frozen=True, slots=True)
class Latency:
    """Of n passages through a stage; s."""

    count: int
    p50: float
    p95: float
    p99: float


def latencies(flight: Flight, window: Window) -> dict[str, Latency]:
    """Each stage of `STAGES` that the log tells of, inside ``window``."""
    return {stage: _latency(times) for stage, times in passages(flight, window).items() if times.size}


def passages(flight: Flight, window: Window) -> dict[str, Vector]:
    """Times (n,) in s of all passages through each stage of `STAGES`, inside ``window``."""
    stages = flight.stages
    inside = window.holds(stages.stamp)
    seen = inside & (stages.stage == Stage.DETECTION)
    sent = inside & (stages.stage == Stage.COMMAND)
    heeded, waited, told = _heeded(flight, seen, sent)
    plans = [p.elapsed for p in flight.plans if p.accepted and window.start <= p.stamp <= window.end]
    found = {
        "camera": (stages.begun - stages.captured)[seen],
        "detection": (stages.stamp - stages.begun)[seen],
        "estimate": waited,
        "plan": np.array(plans),
        "state": (stages.begun - stages.captured)[sent],
        "command": (stages.stamp - stages.begun)[sent],
        "camera to command": told - heeded,
        "pose to command": (stages.stamp - stages.captured)[sent],
    }
    return {stage: found[stage] for stage in STAGES}


def _heeded(flight: Flight, seen: Vector, sent: Vector) -> tuple[Vector, Vector, Vector]:
    """Captures (k,) of frames with gates that a map heeded, how long that took, and when the next command was sent.

    A frame's map is the first between its sightings and those of the next frame; a frame without one was not heeded.
    """
    stages = flight.stages
    captured, there = stages.captured[seen], stages.stamp[seen]
    with_gates = {s.stamp for s in flight.sightings if s.gates}
    maps = np.array([m.stamp for m in flight.maps])
    begun, handed = stages.begun[sent], stages.stamp[sent]
    none = np.zeros(0)
    if not (there.size and maps.size and begun.size):
        return none, none, none
    first = np.searchsorted(maps, there)
    mapped = np.append(maps, np.inf)[first]
    command = np.searchsorted(begun, mapped)
    told = np.append(handed, np.inf)[command]
    useful = np.array([stamp in with_gates for stamp in captured.tolist()], bool)
    kept = useful & (mapped < np.append(there[1:], np.inf)) & np.isfinite(told)
    return captured[kept], (mapped - there)[kept], told[kept]


def _latency(values: Vector) -> Latency:
    p50, p95, p99 = np.percentile(values, (50.0, 95.0, 99.0))
    return Latency(int(values.size), float(p50), float(p95), float(p99))
