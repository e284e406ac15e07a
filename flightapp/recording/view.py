"""What Foxglove shows of a flight: the body's frame, gates and planned line in 3-D, images and messages.

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas.
"""

import math
from typing import Any

import cv2
import numpy as np
from foxglove import Context
from foxglove.channels import CompressedImageChannel, FrameTransformChannel, LogChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CompressedImage,
    FrameTransform,
    LinePrimitive,
    LinePrimitiveLineType,
    Log,
    LogLevel,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    Vector3,
)

from flightapp.evaluation.gates import gate_outline
from flightapp.frames import Vector
from flightapp.messages import Event, Frame, GateEstimate, GateMap, VehicleState
from flightapp.trajectory import Trajectory, hover

TRANSFORM_INTERVAL = 1.0 / 30.0
MAP_INTERVAL = 0.2
LINE_INTERVAL = 1.0
"""s, after which the line is shown again, to those who began to look later."""
LINE_POINTS = 120
JPEG_QUALITY = 80

_GATE_COLOUR = Color(r=0.95, g=0.45, b=0.1, a=1.0)
_LINE_COLOUR = Color(r=0.1, g=0.5, b=0.95, a=1.0)


class View:
    """Writes what Foxglove shows beside the messages, from the same messages, on channels of its own.

    ``opening`` is the side of the gates' openings in metres.
    """

    SHOWN = (VehicleState, GateMap, Trajectory, Frame, Event)

    def __init__(self, context: Context, opening: float) -> None:
        self._opening = opening
        self._transforms = FrameTransformChannel("/view/tf", context=context)
        self._gates = SceneUpdateChannel("/view/gates", context=context)
        self._line = SceneUpdateChannel("/view/trajectory", context=context)
        self._images = CompressedImageChannel("/view/camera", context=context)
        self._log = LogChannel("/view/log", context=context)
        self._transform_due = -math.inf
        self._map_due = -math.inf
        self._planned: Trajectory | None = None
        self._line_due = -math.inf
        hover(0.0, np.zeros(3), 0.0).sample(np.zeros(LINE_POINTS))  # compiles what draws lines, before the flight

    def show(self, message: Any, time: int) -> None:
        """Show ``message``, logged at ``time`` ns, if it is of a kind that is shown and is due."""
        if isinstance(message, VehicleState):
            self._show_state(message, time)
        elif isinstance(message, GateMap):
            self._show_map(message, time)
        elif isinstance(message, Trajectory):
            self._show_trajectory(message, time, message.stamp)
        elif isinstance(message, Frame):
            self._show_frame(message, time)
        elif isinstance(message, Event):
            level = LogLevel.Warning if message.kind == "fault" else LogLevel.Info
            text = Log(timestamp=_timestamp(time), level=level, name=message.kind, message=message.text)
            self._log.log(text, log_time=time)

    def _show_state(self, state: VehicleState, time: int) -> None:
        if state.stamp < self._transform_due:
            return
        if self._planned is not None and state.stamp >= self._line_due:
            self._show_trajectory(self._planned, time, state.stamp)
        self._transform_due = state.stamp + TRANSFORM_INTERVAL
        w, x, y, z = state.orientation.tolist()
        transform = FrameTransform(
            timestamp=_timestamp(time),
            parent_frame_id="world",
            child_frame_id="body",
            translation=_vector(state.position),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )
        self._transforms.log(transform, log_time=time)

    def _show_map(self, gate_map: GateMap, time: int) -> None:
        if gate_map.stamp < self._map_due:
            return
        self._map_due = gate_map.stamp + MAP_INTERVAL
        entities = [
            SceneEntity(
                timestamp=_timestamp(time),
                frame_id="world",
                id=f"gate {gate.gate_id}",
                lines=[_polyline(gate_outline(gate.position, gate.yaw, self._opening), _GATE_COLOUR, 0.08)],
                texts=[TextPrimitive(pose=_label(gate), text=str(gate.gate_id), font_size=0.4, color=_GATE_COLOUR)],
            )
            for gate in gate_map.gates
        ]
        self._gates.log(SceneUpdate(entities=entities), log_time=time)

    def _show_trajectory(self, trajectory: Trajectory, time: int, stamp: float) -> None:
        self._planned, self._line_due = trajectory, stamp + LINE_INTERVAL
        points = trajectory.sample(np.linspace(0.0, trajectory.duration, LINE_POINTS)).position
        line = _polyline(points, _LINE_COLOUR, 0.04)
        entity = SceneEntity(timestamp=_timestamp(time), frame_id="world", id="trajectory", lines=[line])
        self._line.log(SceneUpdate(entities=[entity]), log_time=time)

    def _show_frame(self, frame: Frame, time: int) -> None:
        if frame.image is None:
            return
        _, jpeg = cv2.imencode(".jpg", frame.image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        image = CompressedImage(timestamp=_timestamp(time), frame_id="camera", data=jpeg.tobytes(), format="jpeg")
        self._images.log(image, log_time=time)


def _timestamp(time: int) -> Timestamp:
    return Timestamp(sec=time // 1_000_000_000, nsec=time % 1_000_000_000)


def _vector(v: Vector) -> Vector3:
    x, y, z = v.tolist()
    return Vector3(x=x, y=y, z=z)


def _label(gate: GateEstimate) -> Pose:
    return Pose(position=_vector(gate.position), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))


def _polyline(points: Vector, colour: Color, thickness: float) -> LinePrimitive:
    vertices = [Point3(x=x, y=y, z=z) for x, y, z in points.tolist()]
    return LinePrimitive(type=LinePrimitiveLineType.LineStrip, thickness=thickness, points=vertices, color=colour)
