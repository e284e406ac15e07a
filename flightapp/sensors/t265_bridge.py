#!/usr/bin/env python3
"""Sends an Intel RealSense T265's poses to flightapp, from an interpreter of its own.

    python3 t265_bridge.py [127.0.0.1:5601 | /run/flightapp/poses]

A script that stands alone, for Python 3.6 or newer with a pyrealsense2 that knows the T265: 2.53.1 is the last, 2.50.0
the last that was validated with it. It sends each pose as one datagram (`POSE_RECORD` in `flightapp/sensors/poses.py`),
opens the camera again when it was unplugged (its frame then is another: the epoch changes), and ends on SIGTERM or ^C.

The T265's world is gravity-aligned, x right, y up, z back, with its origin and heading where it was switched on; its
body has the same axes. Here both become forward, left, up: (x, y, z) -> (-z, -x, y), and a quaternion's vector part
likewise. It reports velocity, acceleration (without gravity) and angular velocity in its world (librealsense's ROS
driver turns them into the body, `pose_callback` of realsense-ros 2.x); here the angular velocity is turned too.
"""

# ruff: noqa: UP006, UP035, UP045

import argparse
import contextlib
import importlib
import signal
import socket
import struct
import sys
import time
from typing import Any, Callable, Optional, Tuple

RECORD = struct.Struct("<4sHHQ17d")
MAGIC, VERSION = b"POSE", 2
DEFAULT = "127.0.0.1:5601"
SILENT = 500
"""ms without a pose after which the camera is opened again."""
RETRY = 1.0
"""s between attempts to open it."""
AGE_MAX = 0.5
"""s, an older pose's stamp is by a clock that is not this computer's."""
MEND = (
    "2.53.1 is the last that knows the T265, 2.50.0 the last that was validated with it (wheels for Python 3.6 to 3.9):"
    " pip install pyrealsense2==2.50.0.3812"
)

Numbers = Tuple[float, ...]


def measured(pose: Any) -> Tuple[Numbers, Numbers, Numbers, Numbers, Numbers]:
    """Position, orientation (w, x, y, z), velocity, angular velocity (body) and acceleration of an rs2_pose."""
    turn = pose.rotation
    w, x, y, z = turn.w, -turn.z, -turn.x, turn.y
    omega = _turned_back(w, x, y, z, _flu(pose.angular_velocity))
    return _flu(pose.translation), (w, x, y, z), _flu(pose.velocity), omega, _flu(pose.acceleration)


def captured(frame: Any, domains: Any, now: float) -> float:
    """When ``frame`` was captured, by the clock that shows ``now`` (s); its arrival where the frame does not tell.

    ``domains`` is pyrealsense2.timestamp_domain. The camera's stamps are by the wall clock, which may be set at any
    time: only the age is used.
    """
    if frame.get_frame_timestamp_domain() not in (domains.global_time, domains.system_time):
        return now
    age = time.time() - 1e-3 * float(frame.get_timestamp())
    return now - max(age, 0.0) if -0.01 < age < AGE_MAX else now


def opened(rs: Any, callback: Optional[Callable[[Any], None]] = None) -> Any:
    """A started pipeline of poses, to ``callback`` (on a thread of its own) or to be waited for; raises RuntimeError.

    Jumps are switched off: after a relocalisation the T265 then goes on from where it was.
    """
    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.pose)
    device = config.resolve(rs.pipeline_wrapper(pipeline)).get_device()
    device.first_pose_sensor().set_option(rs.option.enable_pose_jumping, 0)
    if callback is None:
        pipeline.start(config)
    else:
        pipeline.start(config, callback)
    return pipeline


def _flu(v: Any) -> Numbers:
    return (-v.z, -v.x, v.y)


def _turned_back(w: float, x: float, y: float, z: float, v: Numbers) -> Numbers:
    """``v`` turned by the inverse of the unit quaternion."""
    tx, ty, tz = 2.0 * (v[1] * z - v[2] * y), 2.0 * (v[2] * x - v[0] * z), 2.0 * (v[0] * y - v[1] * x)
    return (
        v[0] + w * tx + (ty * z - tz * y),
        v[1] + w * ty + (tz * x - tx * z),
        v[2] + w * tz + (tx * y - ty * x),
    )


class Sender:
    """Sends datagrams to a path or HOST:PORT; what nobody receives is lost."""

    def __init__(self, address: str) -> None:
        self._to: Any = address
        family = socket.AF_UNIX
        if not address.startswith("/"):
            host, _, port = address.rpartition(":")
            self._to, family = (host, int(port)), socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._heard = True

    def send(self, data: bytes) -> None:
        """Send ``data``, and say it once when nobody receives it any more, or again."""
        try:
            self._socket.sendto(data, self._to)
            heard = True
        except OSError as error:
            heard, why = False, error.strerror
        if heard != self._heard:
            _say("received again" if heard else f"nobody receives at {self._to}: {why}")
        self._heard = heard


class Bridge:
    """From the camera to the socket, until told to stop."""

    def __init__(self, rs: Any, sender: Sender) -> None:
        self._rs = rs
        self._sender = sender
        # Another number than any earlier process had, since the camera's frame starts anew with each.
        self._epoch = int(1000 * time.monotonic())
        self._stopped = False

    def stop(self, *_: Any) -> None:
        """End `run` soon."""
        self._stopped = True

    def run(self) -> None:
        """Open the camera, again and again, and send what it says."""
        told = ""
        while not self._stopped:
            try:
                pipeline = opened(self._rs)
            except RuntimeError as error:
                if str(error) != told:
                    told = str(error)
                    _say(f"waiting for the T265: {told}")
                self._pause()
                continue
            told = ""
            self._epoch += 1
            _say("the T265 is open")
            self._pass_on(pipeline)

    def _pass_on(self, pipeline: Any) -> None:
        try:
            while not self._stopped:
                frame = pipeline.wait_for_frames(SILENT).get_pose_frame()
                if frame:
                    self._send(frame)
        except RuntimeError as error:
            _say(f"the T265 is gone: {error}")
        finally:
            with contextlib.suppress(RuntimeError):  # where it has stopped by itself
                pipeline.stop()

    def _send(self, frame: Any) -> None:
        stamp = captured(frame, self._rs.timestamp_domain, time.monotonic())
        pose = frame.get_pose_data()
        position, orientation, velocity, omega, acceleration = measured(pose)
        numbers = (stamp, *position, *orientation, *velocity, *omega, *acceleration)
        confidence = min(max(int(pose.tracker_confidence), 0), 3)
        self._sender.send(RECORD.pack(MAGIC, VERSION, confidence, self._epoch, *numbers))

    def _pause(self) -> None:
        until = time.monotonic() + RETRY
        while not self._stopped and time.monotonic() < until:
            time.sleep(0.05)


def _say(text: str) -> None:
    sys.stderr.write(f"t265_bridge: {text}\n")
    sys.stderr.flush()


def main() -> int:
    """Run the script; the exit status."""
    parser = argparse.ArgumentParser(description="Sends a T265's poses to flightapp.")
    parser.add_argument("address", nargs="?", default=DEFAULT, help="path or HOST:PORT (sensors.pose_address)")
    address = parser.parse_args().address
    try:
        rs = importlib.import_module("pyrealsense2")
    except ImportError as error:
        _say(f"{error}; {MEND}")
        return 2
    try:
        sender = Sender(address)
    except ValueError:
        _say(f"'{address}' is not an address: give a path or HOST:PORT")
        return 2
    bridge = Bridge(rs, sender)
    signal.signal(signal.SIGTERM, bridge.stop)
    signal.signal(signal.SIGINT, bridge.stop)
    bridge.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
