"""A stand-in for pyrealsense2 2.50 with a T265 that moves as `pose_at` says.

FAKE_T265 in the environment, or `script`, is a JSON object: "absent": how many times there is no camera when it is
opened; "frames": after how many poses it is unplugged; "domain": of its stamps.
"""

import json
import math
import os
import threading
import time
from types import SimpleNamespace

__version__ = "2.50.0"

script = json.loads(os.environ.get("FAKE_T265", "{}"))
stream = SimpleNamespace(pose="pose")
option = SimpleNamespace(enable_pose_jumping="enable_pose_jumping")
camera_info = SimpleNamespace(name="name")
timestamp_domain = SimpleNamespace(hardware_clock=0, system_time=1, global_time=2)
opened = []
names = ["Intel RealSense T265"]


def xyz(x, y, z, **more):
    return SimpleNamespace(x=x, y=y, z=z, **more)


def pose_at(count):
    """Sample ``count``: in the T265's axes, turned by 90° to the left, moving."""
    half = math.sqrt(0.5)
    return SimpleNamespace(
        translation=xyz(0.1, 0.2, -3.0 - 0.001 * count),
        velocity=xyz(0.4, 0.5, -0.6),
        acceleration=xyz(0.7, 0.8, -0.9),
        rotation=xyz(0.0, half, 0.0, w=half),
        angular_velocity=xyz(1.0, 2.0, -3.0),
        tracker_confidence=2,
        mapper_confidence=1,
    )


class Frame:
    def __init__(self, count):
        self.count = count
        self.captured = time.time() - 0.006

    def __bool__(self):
        return True

    def get_pose_frame(self):
        return self

    as_pose_frame = get_pose_frame

    def is_frameset(self):
        return False

    def get_pose_data(self):
        return pose_at(self.count)

    def get_timestamp(self):
        return 1e3 * self.captured

    def get_frame_timestamp_domain(self):
        return script.get("domain", timestamp_domain.global_time)


class Sensor:
    def set_option(self, name, value):
        assert (name, value) == (option.enable_pose_jumping, 0)


class Device:
    def get_device(self):
        return self

    def first_pose_sensor(self):
        return Sensor()

    def get_info(self, which):
        return names[0]


class Context:
    def query_devices(self):
        return [Device()] if names else []


class Settings:
    def enable_stream(self, which):
        assert which == stream.pose

    def resolve(self, wrapper):
        if script.get("absent", 0) > 0:
            script["absent"] -= 1
            raise RuntimeError("No device connected")
        return Device()


def pipeline_wrapper(wrapped):
    return wrapped


class Pipeline:
    def __init__(self):
        self.count = 0
        self.running = False

    def start(self, settings, callback=None):
        opened.append(self)
        self.running = True
        if callback is not None:
            threading.Thread(target=self._call, args=(callback,), daemon=True).start()

    def _call(self, callback):
        while self.running and self.count < script.get("frames", math.inf):
            time.sleep(0.005)
            self.count += 1
            callback(Frame(self.count))

    def wait_for_frames(self, timeout):
        assert timeout == 500
        time.sleep(0.005)
        if self.count >= script.get("frames", math.inf):
            raise RuntimeError("Frame didn't arrive within 500")
        self.count += 1
        return Frame(self.count)

    def stop(self):
        if not self.running:
            raise RuntimeError("stop() cannot be called before start()")
        self.running = False


context, config, pipeline = Context, Settings, Pipeline
