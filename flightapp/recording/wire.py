"""Fast encoding of the messages that flow at rate: protobuf of a constant length.

Every field is always present (scalars as fixed64 or fixed32, arrays as packed doubles of a known length), so
tags and lengths are constants and a message is one `struct` pack to write, and a row of a numpy structured
array to read. Any protobuf reader can decode the result with the schema in the log. Wire format:
https://protobuf.dev/programming-guides/encoding/.
"""

import math
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from flightapp.messages import GroundTruth, ImuSample, PoseSample, RateCommand, Setpoint, StageTime, VehicleState

PACKAGE = "flightapp"
_FIXED64, _LENGTH, _FIXED32 = 1, 2, 5

Encode = Callable[[Any], bytes]


class Layout:
    """The constant layout of one protobuf message.

    ``fields`` maps names to widths: 0 for a double, -1 for an unsigned 32-bit integer, n for n doubles; they are
    numbered from ``first``.
    """

    def __init__(self, name: str, fields: Mapping[str, int], first: int = 1) -> None:
        self.name = f"{PACKAGE}.{name}"
        self.tags: list[bytes] = []
        names, formats, offsets = [], [], []
        packing, offset = "<", 0
        for number, (field, width) in enumerate(fields.items(), start=first):
            if width > 0:
                tag = prefix(number, 8 * width)
                code, form = f"{width}d", f"({width},)<f8"
            else:
                tag = bytes((number << 3 | (_FIXED32 if width < 0 else _FIXED64),))
                code, form = ("I", "<u4") if width < 0 else ("d", "<f8")
            self.tags.append(tag)
            names.append(field)
            formats.append(form)
            offsets.append(offset + len(tag))
            packing += f"{len(tag)}s{code}"
            offset = struct.calcsize(packing)
        self.pack = struct.Struct(packing).pack
        self.size = offset
        self.dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": offset})
        self.schema = descriptor_set(name, [descriptor(name, fields)])

    def columns(self, payloads: list[bytes]) -> Mapping[str, Any]:
        """Arrays by field, one row for each of ``payloads``; raises ValueError where a length is wrong."""
        if any(len(payload) != self.size for payload in payloads):
            raise ValueError(f"a {self.name} is {self.size} bytes long")
        rows = np.frombuffer(b"".join(payloads), self.dtype)
        names = self.dtype.names or ()
        return {name: np.ascontiguousarray(rows[name]) for name in names}


def prefix(number: int, length: int) -> bytes:
    """Tag of the field ``number`` (at most 15) and ``length`` of what follows, in bytes."""
    encoded = bytearray((number << 3 | _LENGTH,))
    while length > 0x7F:
        encoded.append(length & 0x7F | 0x80)
        length >>= 7
    encoded.append(length)
    return bytes(encoded)


def descriptor(name: str, fields: Mapping[str, int]) -> DescriptorProto:
    """What protobuf is told of the message ``name`` with ``fields`` as in `Layout`."""
    message = DescriptorProto(name=name)
    for number, (field, width) in enumerate(fields.items(), start=1):
        message.field.add(
            name=field,
            number=number,
            label=FieldDescriptorProto.LABEL_REPEATED if width > 0 else FieldDescriptorProto.LABEL_OPTIONAL,
            type=FieldDescriptorProto.TYPE_FIXED32 if width < 0 else FieldDescriptorProto.TYPE_DOUBLE,
        )
    return message


def descriptor_set(name: str, messages: Iterable[DescriptorProto]) -> bytes:
    """The schema of the message ``name``, described by the last of ``messages``, which needs the others."""
    file = FileDescriptorProto(name=f"{PACKAGE}/{name}.proto", package=PACKAGE, syntax="proto3", message_type=messages)
    encoded: bytes = FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)
    return encoded


@dataclass(frozen=True, slots=True)
class Fixed:
    """How one type of message is written."""

    layout: Layout
    encode: Encode


_MOTION = {"stamp": 0, "position": 3, "orientation": 4, "velocity": 3, "angular_velocity": 3}
_POSE = Layout("PoseSample", {**_MOTION, "confidence": -1, "acceleration": 3, "epoch": -1})
_STATE = Layout("VehicleState", {**_MOTION, "variance": 9, "doubtful": -1, "position_covariance": 3})
_TRUTH = Layout("GroundTruth", _MOTION)
_SETPOINT = Layout(
    "Setpoint",
    {"stamp": 0, "position": 3, "velocity": 3, "acceleration": 3, "jerk": 3, "yaw": 0, "yaw_rate": 0},
)
_IMU = Layout("ImuSample", {"stamp": 0, "specific_force": 3, "angular_velocity": 3})
_COMMAND = Layout("RateCommand", {"stamp": 0, "rates": 3, "thrust": 0})
_STAGE = Layout("StageTime", {"stamp": 0, "stage": -1, "captured": 0, "begun": 0})
_UNKNOWN = (math.nan,) * 3
_ROW, _COLUMN = np.array((0, 0, 1)), np.array((1, 2, 2))


def _encode_pose(m: PoseSample) -> bytes:
    t = _POSE.tags
    return _POSE.pack(
        *(t[0], m.stamp, t[1], *m.position.tolist(), t[2], *m.orientation.tolist()),
        *(t[3], *m.velocity.tolist(), t[4], *m.angular_velocity.tolist(), t[5], m.confidence),
        *(t[6], *(_UNKNOWN if m.acceleration is None else m.acceleration.tolist()), t[7], m.epoch),
    )


def _encode_state(m: VehicleState) -> bytes:
    t = _STATE.tags
    return _STATE.pack(
        *(t[0], m.stamp, t[1], *m.position.tolist(), t[2], *m.orientation.tolist()),
        *(t[3], *m.velocity.tolist(), t[4], *m.angular_velocity.tolist(), t[5], *m.covariance.diagonal().tolist()),
        *(t[6], m.doubt != "", t[7], *m.covariance[_ROW, _COLUMN].tolist()),
    )


def _encode_truth(m: GroundTruth) -> bytes:
    t = _TRUTH.tags
    return _TRUTH.pack(
        *(t[0], m.stamp, t[1], *m.position.tolist(), t[2], *m.orientation.tolist()),
        *(t[3], *m.velocity.tolist(), t[4], *m.angular_velocity.tolist()),
    )


def _encode_setpoint(m: Setpoint) -> bytes:
    t = _SETPOINT.tags
    return _SETPOINT.pack(
        *(t[0], m.stamp, t[1], *m.position.tolist(), t[2], *m.velocity.tolist()),
        *(t[3], *m.acceleration.tolist(), t[4], *m.jerk.tolist(), t[5], m.yaw, t[6], m.yaw_rate),
    )


def _encode_imu(m: ImuSample) -> bytes:
    t = _IMU.tags
    return _IMU.pack(t[0], m.stamp, t[1], *m.specific_force.tolist(), t[2], *m.angular_velocity.tolist())


def _encode_command(m: RateCommand) -> bytes:
    t = _COMMAND.tags
    return _COMMAND.pack(t[0], m.stamp, t[1], *m.rates.tolist(), t[2], m.thrust)


def _encode_stage(m: StageTime) -> bytes:
    t = _STAGE.tags
    return _STAGE.pack(t[0], m.stamp, t[1], m.stage, t[2], m.captured, t[3], m.begun)


FIXED: Mapping[type, Fixed] = {
    PoseSample: Fixed(_POSE, _encode_pose),
    VehicleState: Fixed(_STATE, _encode_state),
    GroundTruth: Fixed(_TRUTH, _encode_truth),
    Setpoint: Fixed(_SETPOINT, _encode_setpoint),
    ImuSample: Fixed(_IMU, _encode_imu),
    RateCommand: Fixed(_COMMAND, _encode_command),
    StageTime: Fixed(_STAGE, _encode_stage),
}
"""Every message type that is written this way.

Of a state's covariance only the diagonal is kept (variance), and of its doubt whether there is any: events tell why.
"""
