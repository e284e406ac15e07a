"""What the simulated world's process sends to the application's, as datagrams; poses go as `POSE_RECORD`.

Both ends are the same program on the same computer.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from struct import Struct

import numpy as np

from flightapp.frames import Vector
from flightapp.messages import Collision, CommandArrivals, GatePassage, GroundTruth, MarkerDetection

MOTIONS, PASSAGE, COLLISION, ARRIVALS = b"m", b"p", b"c", b"a"
"""First byte of a datagram of truth."""
_MOTION = 14
"""Numbers of a motion: stamp, position, orientation, velocity, angular velocity."""
_STAMP, _PASSAGE, _COLLISION, _NOTICE = Struct("<d"), Struct("<dqd"), Struct("<dd"), Struct("<dqq")
_MARKER = np.dtype([("id", "<i8"), ("corners", "<f8", (4, 2)), ("noise", "<f8")])
NO_IMAGE = -1
NOTICE_SIZE = 1 << 16
"""Bytes that hold every notice."""


@dataclass(frozen=True, slots=True)
class Notice:
    """There is a new frame."""

    stamp: float
    sequence: int
    slot: int
    """Where its image lies in the ring; `NO_IMAGE` from a camera that finds the markers itself."""
    markers: tuple[MarkerDetection, ...] = ()


def pack_motions(motions: Sequence[GroundTruth]) -> bytes:
    """Several true motions in one datagram."""
    rows = np.empty((len(motions), _MOTION))
    for row, motion in zip(rows, motions, strict=True):
        row[0] = motion.stamp
        row[1:4], row[4:8] = motion.position, motion.orientation
        row[8:11], row[11:14] = motion.velocity, motion.angular_velocity
    return MOTIONS + rows.tobytes()


def pack_verdict(verdict: GatePassage | Collision) -> bytes:
    """A referee's verdict."""
    if isinstance(verdict, GatePassage):
        return PASSAGE + _PASSAGE.pack(verdict.stamp, verdict.gate_id, verdict.offset)
    return COLLISION + _COLLISION.pack(verdict.stamp, verdict.speed) + verdict.obstacle.encode()


def pack_arrivals(arrivals: CommandArrivals) -> bytes:
    """When commands arrived at the vehicle."""
    return ARRIVALS + _STAMP.pack(arrivals.stamp) + arrivals.stamps.tobytes()


def unpack_truth(datagram: bytes) -> Iterable[GroundTruth | GatePassage | Collision | CommandArrivals]:
    """What a datagram of truth holds."""
    kind, body = datagram[:1], datagram[1:]
    if kind == MOTIONS:
        rows = np.frombuffer(body).reshape(-1, _MOTION).copy()
        return [GroundTruth(float(r[0]), r[1:4], r[4:8], r[8:11], r[11:14]) for r in rows]
    if kind == PASSAGE:
        return [GatePassage(*_PASSAGE.unpack(body))]
    if kind == ARRIVALS:
        (stamp,) = _STAMP.unpack_from(body)
        return [CommandArrivals(stamp, np.frombuffer(body, offset=_STAMP.size).copy())]
    stamp, speed = _COLLISION.unpack_from(body)
    return [Collision(stamp, body[_COLLISION.size :].decode(), speed)]


def pack_notice(notice: Notice) -> bytes:
    """A frame's notice, with the markers found."""
    head = _NOTICE.pack(notice.stamp, notice.sequence, notice.slot)
    if not notice.markers:
        return head
    rows = np.empty(len(notice.markers), _MARKER)
    rows["id"] = [marker.marker_id for marker in notice.markers]
    rows["corners"] = [marker.corners for marker in notice.markers]
    rows["noise"] = [marker.noise for marker in notice.markers]
    return head + rows.tobytes()


def unpack_notice(datagram: bytes) -> Notice:
    """The notice in a datagram."""
    stamp, sequence, slot = _NOTICE.unpack_from(datagram)
    rows = np.frombuffer(datagram, _MARKER, offset=_NOTICE.size)
    corners: Vector = rows["corners"].copy()
    each = zip(rows["id"], corners, rows["noise"], strict=True)
    found = (MarkerDetection(int(i), c, noise=float(noise)) for i, c, noise in each)
    return Notice(stamp, sequence, slot, tuple(found))
