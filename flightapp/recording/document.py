"""The log's topics and their messages as a page of the documentation."""

import ast
import inspect
import itertools
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Any, get_args, get_origin, get_type_hints

from google.protobuf.descriptor_pb2 import FileDescriptorSet

from flightapp import messages as m
from flightapp.recording.nested import NESTED
from flightapp.recording.records import TrueGates
from flightapp.recording.wire import FIXED
from flightapp.trajectory import Trajectory

INTRODUCTION = """# Log topics

What `flight.mcap` holds. It is an MCAP file; every topic carries its schema, so that any MCAP or Foxglove reader opens
it, and `flightapp.recording.reader.read_flight` reads it back as arrays. The metadata record `flight` has the header:
mission, seed, track, effective configuration, outcome. Messages that flow at rate are protobuf, the others JSON, in
which numbers that are not finite are the strings "NaN", "Infinity" and "-Infinity". A message is logged at its stamp:
seconds of the flight's clock at capture (see [Conventions](conventions.md)).

Topics that begin with `/view/` show the flight in Foxglove, with Foxglove's own schemas: `/view/tf`, `/view/gates`,
`/view/trajectory`, `/view/camera` (JPEG, one frame in `recording.image_every`) and `/view/log`.

## Topics
"""

TOPICS: Mapping[str, tuple[type, str]] = {
    "sightings": (m.Sightings, "each frame that was looked at"),
    "pose": (m.PoseSample, "the tracker, about 200 Hz"),
    "imu": (m.ImuSample, "the autopilot's inertial sensors, `link.imu_rate`"),
    "state": (m.VehicleState, "each pose, and where inertial sensors stand in for poses"),
    "gate_map": (m.GateMap, "each sighting that changes it"),
    "trajectory": (Trajectory, "each line that is flown"),
    "plan": (m.PlanReport, "each call of the planner"),
    "setpoint": (m.Setpoint, "each tick of the control task, `control.rate`"),
    "command": (m.RateCommand, "each tick of the control task, `control.rate`"),
    "autopilot": (m.AutopilotStatus, "when the autopilot tells"),
    "event": (m.Event, "when something happens"),
    "load": (m.ProcessLoad, "now and then"),
    "stage": (m.StageTime, "each frame and each command"),
    "truth": (m.GroundTruth, "simulation or motion capture"),
    "true_gates": (TrueGates, "simulation, once"),
    "passage": (m.GatePassage, "simulation, at each gate"),
    "collision": (m.Collision, "simulation, at each touch"),
    "arrivals": (m.CommandArrivals, "simulation behind MAVLink"),
}
"""By name: the message, and when it comes."""
PARTS = (m.MarkerDetection, m.GateSighting, m.GateEstimate, m.Drift)
"""What other messages are made of."""
AS_WRITTEN: Mapping[type, Mapping[str, str]] = {
    m.VehicleState: {
        "variance": "(9,) the covariance's diagonal: position (m²), velocity (m²/s²), rotation vector (rad²).",
        "doubtful": "1 where it is not to be trusted; events tell why.",
        "position_covariance": "(3,) m², the position's xy, xz and yz.",
    },
    m.PoseSample: {"acceleration": "(3,) m/s², odom, without gravity; NaN where the tracker doesn't tell."},
    m.GateSighting: {
        "alternative_position": "(3,) m, of the other pose that explains an ambiguous square nearly as well.",
        "alternative_orientation": "(4,) q_bg of it.",
    },
    m.StageTime: {"stage": ", ".join(f"{stage.value} {stage.name.lower()}" for stage in m.Stage) + "."},
}
"""Fields that are written otherwise than they are in flight."""
EVERYWHERE = {
    "stamp": "s, monotonic, at capture.",
    "gate_id": "As in the track.",
    "marker_id": "As in the dictionary.",
    "sequence": "Of the frame.",
}


def document() -> str:
    """The page, in Markdown."""
    lines = [INTRODUCTION, "| topic | message | encoding | comes with |", "| --- " * 4 + "|"]
    for topic, (kind, when) in TOPICS.items():
        encoding = "protobuf" if kind in FIXED or kind in NESTED else "JSON"
        lines.append(f"| `{topic}` | [{kind.__name__}](#{kind.__name__.lower()}) | {encoding} | {when} |")
    lines += ["", "## Messages", ""]
    for kind in (*dict.fromkeys(kind for kind, _ in TOPICS.values()), *PARTS):
        lines += [f"### {kind.__name__}", "", " ".join((inspect.getdoc(kind) or "").split()), ""]
        lines += ["| field | |", "| --- | --- |"]
        lines += [f"| `{field}` | {meaning} |" for field, meaning in _fields(kind)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _fields(kind: type) -> Iterator[tuple[str, str]]:
    told = {**EVERYWHERE, **field_docs(kind), **AS_WRITTEN.get(kind, {})}
    for name in written_fields(kind):
        meaning = told.get(name) or _type(get_type_hints(kind)[name])
        yield name, " ".join(meaning.split()).replace("|", "&#124;")


def _type(kind: Any) -> str:
    """In words, for a field of which the source says no more than its name and type."""
    if get_origin(kind) is tuple:
        return f"List of {get_args(kind)[0].__name__}."
    if issubclass(kind, Enum):
        return f"One of: {', '.join(str(member.value) for member in kind)}."
    return {bool: "True or false.", int: "Integer.", float: "Number.", str: "Text."}.get(kind, f"{kind.__name__}.")


@cache
def written_fields(kind: type) -> tuple[str, ...]:
    """The names of the fields of ``kind`` as it is written."""
    schemas = [fixed.layout.schema for fixed in FIXED.values()] + [nested.schema for nested in NESTED.values()]
    for schema in schemas:
        for message in FileDescriptorSet.FromString(schema).file[0].message_type:
            if message.name == kind.__name__:
                return tuple(field.name for field in message.field)
    return tuple(field.name for field in fields(kind))


def field_docs(kind: type) -> dict[str, str]:
    """What the source of ``kind`` says of its fields, in the string below each."""
    tree = ast.parse(inspect.getsource(sys.modules[kind.__module__]))
    body = next(node.body for node in tree.body if isinstance(node, ast.ClassDef) and node.name == kind.__name__)
    return {
        field.target.id: doc.value.value
        for field, doc in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(doc, ast.Expr) and isinstance(doc.value, ast.Constant) and isinstance(doc.value.value, str)
    }
