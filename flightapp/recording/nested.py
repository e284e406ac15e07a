"""Fast encoding of what is seen and mapped in every frame: protobuf messages made of parts of constant length.

A part is one `struct` pack behind its tag and length; a message is its parts one after the other. Reading
goes through protobuf itself, with the schema of this version.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet

from flightapp.frames import Vector
from flightapp.messages import Drift, GateEstimate, GateMap, GateSighting, MarkerDetection, Sightings
from flightapp.recording.wire import PACKAGE, Encode, Layout, descriptor, descriptor_set, prefix

_GATE_FIELDS = {
    **{"gate_id": -1, "position": 3, "yaw": 0, "covariance": 16, "sightings": -1, "last_seen": 0},
    "surveyed": -1,
}
_DRIFT_FIELDS = {"stamp": 0, "translation": 3, "yaw": 0, "covariance": 16}
_MARKER_FIELDS = {"marker_id": -1, "corners": 8, "quality": 0, "noise": 0}
_SIGHTING_FIELDS = {
    **{"stamp": 0, "gate_id": -1, "position": 3, "orientation": 4, "covariance": 36, "markers": -1},
    "reprojection": 0,
}
_ALTERNATIVE_FIELDS = {"alternative_position": 3, "alternative_orientation": 4}

_GATE = Layout("GateEstimate", _GATE_FIELDS)
_DRIFT = Layout("Drift", _DRIFT_FIELDS)
_MARKER = Layout("MarkerDetection", _MARKER_FIELDS)
_SIGHTING = Layout("GateSighting", _SIGHTING_FIELDS)
_ALTERNATIVE = Layout("GateSighting", _ALTERNATIVE_FIELDS, first=len(_SIGHTING_FIELDS) + 1)
_MAP_HEAD = Layout("GateMap", {"stamp": 0, "version": -1})
_SEEN_HEAD = Layout("Sightings", {"stamp": 0, "sequence": -1})

_GATE_PREFIX, _DRIFT_PREFIX = prefix(3, _GATE.size), prefix(4, _DRIFT.size)
_MARKER_PREFIX, _CLEAR_PREFIX = prefix(3, _MARKER.size), prefix(4, _SIGHTING.size)
_AMBIGUOUS_PREFIX = prefix(4, _SIGHTING.size + _ALTERNATIVE.size)


@dataclass(frozen=True, slots=True)
class Nested:
    """How one type of message is written and read."""

    schema: bytes
    encode: Encode
    decode: Callable[[bytes], Any]


def _encode_gate(m: GateEstimate) -> bytes:
    t = _GATE.tags
    return _GATE.pack(
        *(t[0], m.gate_id, t[1], *m.position.tolist(), t[2], m.yaw),
        *(t[3], *m.covariance.ravel().tolist(), t[4], m.sightings, t[5], m.last_seen, t[6], m.surveyed),
    )


def _encode_drift(m: Drift) -> bytes:
    t = _DRIFT.tags
    return _DRIFT.pack(
        *(t[0], m.stamp, t[1], *m.translation.tolist(), t[2], m.yaw, t[3], *m.covariance.ravel().tolist())
    )


def _encode_map(m: GateMap) -> bytes:
    t = _MAP_HEAD.tags
    parts = [_MAP_HEAD.pack(t[0], m.stamp, t[1], m.version)]
    for gate in m.gates:
        parts += (_GATE_PREFIX, _encode_gate(gate))
    parts += (_DRIFT_PREFIX, _encode_drift(m.drift))
    return b"".join(parts)


def _encode_sighting(m: GateSighting) -> tuple[bytes, ...]:
    t = _SIGHTING.tags
    pose = _SIGHTING.pack(
        *(t[0], m.stamp, t[1], m.gate_id, t[2], *m.position.tolist(), t[3], *m.orientation.tolist()),
        *(t[4], *m.covariance.ravel().tolist(), t[5], m.markers, t[6], m.reprojection),
    )
    if m.alternative is None:
        return _CLEAR_PREFIX, pose
    t = _ALTERNATIVE.tags
    position, orientation = m.alternative
    return _AMBIGUOUS_PREFIX, pose, _ALTERNATIVE.pack(t[0], *position.tolist(), t[1], *orientation.tolist())


def _encode_sightings(m: Sightings) -> bytes:
    t = _SEEN_HEAD.tags
    parts = [_SEEN_HEAD.pack(t[0], m.stamp, t[1], m.sequence)]
    t = _MARKER.tags
    for marker in m.markers:
        parts += (
            _MARKER_PREFIX,
            _MARKER.pack(
                *(t[0], marker.marker_id, t[1], *marker.corners.ravel().tolist()),
                *(t[2], marker.quality, t[3], marker.noise),
            ),
        )
    for gate in m.gates:
        parts += _encode_sighting(gate)
    return b"".join(parts)


def _array(values: Any, *shape: int) -> Vector:
    return np.array(values, float).reshape(shape)


def _gate(m: Any) -> GateEstimate:
    covariance, surveyed = _array(m.covariance, 4, 4), bool(m.surveyed)
    return GateEstimate(m.gate_id, _array(m.position, 3), m.yaw, covariance, m.sightings, m.last_seen, surveyed)


def _map(m: Any) -> GateMap:
    d = m.drift
    drift = Drift(d.stamp, _array(d.translation, 3), d.yaw, _array(d.covariance, 4, 4))
    return GateMap(m.stamp, m.version, tuple(map(_gate, m.gates)), drift)


def _sighting(m: Any) -> GateSighting:
    pose = _array(m.position, 3), _array(m.orientation, 4)
    other = None
    if m.alternative_position:
        other = _array(m.alternative_position, 3), _array(m.alternative_orientation, 4)
    return GateSighting(m.stamp, m.gate_id, *pose, _array(m.covariance, 6, 6), other, m.markers, m.reprojection)


def _sightings(m: Any) -> Sightings:
    markers = tuple(
        MarkerDetection(marker.marker_id, _array(marker.corners, 4, 2), marker.quality, marker.noise)
        for marker in m.markers
    )
    return Sightings(m.stamp, m.sequence, markers, tuple(map(_sighting, m.gates)))


def _outer(name: str, head: Mapping[str, int], parts: Mapping[str, tuple[str, bool]]) -> DescriptorProto:
    """The descriptor of a message of ``head`` and then ``parts``: their type, and whether there are many."""
    message = descriptor(name, head)
    for number, (field, (kind, many)) in enumerate(parts.items(), start=len(head) + 1):
        message.field.add(
            name=field,
            number=number,
            label=FieldDescriptorProto.LABEL_REPEATED if many else FieldDescriptorProto.LABEL_OPTIONAL,
            type=FieldDescriptorProto.TYPE_MESSAGE,
            type_name=f".{PACKAGE}.{kind}",
        )
    return message


def _nested(messages: list[DescriptorProto], encode: Encode, build: Callable[[Any], Any]) -> Nested:
    name = messages[-1].name
    schema = descriptor_set(name, messages)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(FileDescriptorSet.FromString(schema).file[0])
    parse = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{name}")).FromString
    return Nested(schema, encode, lambda data: build(parse(data)))


NESTED: Mapping[type, Nested] = {
    GateMap: _nested(
        [
            descriptor("GateEstimate", _GATE_FIELDS),
            descriptor("Drift", _DRIFT_FIELDS),
            _outer(
                "GateMap", {"stamp": 0, "version": -1}, {"gates": ("GateEstimate", True), "drift": ("Drift", False)}
            ),
        ],
        _encode_map,
        _map,
    ),
    Sightings: _nested(
        [
            descriptor("MarkerDetection", _MARKER_FIELDS),
            descriptor("GateSighting", {**_SIGHTING_FIELDS, **_ALTERNATIVE_FIELDS}),
            _outer(
                "Sightings",
                {"stamp": 0, "sequence": -1},
                {"markers": ("MarkerDetection", True), "gates": ("GateSighting", True)},
            ),
        ],
        _encode_sightings,
        _sightings,
    ),
}
"""Every message type that is written this way. A sighting's alternative is two fields, absent where there is none."""
