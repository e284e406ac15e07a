"""The application as its user runs it, in a process of its own, and the world around it, held by the test.

The application flies the rig of a real vehicle: MAVLink to a simulated PX4 that the test lets fail, and poses of a
simulated tracker that pass through the test's hands. So it can be stopped and killed, and is judged by the world's
truth.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightapp.config import load_config
from flightapp.messages import Collision
from flightapp.sensors.poses import POSE_RECORD
from flightapp.track import load_track
from sim.orders import Order
from sim.remote import RemoteWorld

TRACK = """
name = "pad"
waypoints = [[1.0, 0.0, 1.0]]
[start]
position = [0.0, 0.0, 0.0]
"""
MISSION = '''
import ctypes, sys, time
from flightapp.control.flatness import FlatnessController

TRACK = "track.toml"
controlled = FlatnessController.command

def say(*words):
    print(*words, flush=True)

async def mission(drone):
    """Up, whatever the test has in mind, down."""
    {prelude}
    await drone.takeoff(1.0)
    {work}
    await drone.land()
'''
PATIENCE = 60.0
"""s after which whatever is waited for will not happen any more."""


class Moment(NamedTuple):
    """The truth at one time (CLOCK_MONOTONIC, s)."""

    stamp: float
    mode: str
    armed: bool
    position: np.ndarray
    """(3,) m, world."""

    @property
    def height(self):
        """m above the ground."""
        return float(self.position[2])


class Flight:
    """One flight; a context manager, after which nothing is left running."""

    def __init__(self, directory, work="await drone.hover(20.0)", prelude="", settings=(), faults=()):
        """``work`` and ``prelude`` are lines of the mission; ``faults`` (s, name, value) are those of sim.faults."""
        self.out = directory / "run"
        link, poses = _free_ports(2)
        (directory / "track.toml").write_text(TRACK)
        (directory / "mission.py").write_text(MISSION.format(work=_lines(work), prelude=_lines(prelude)))
        self._output = (directory / "output.txt").open("w+")
        given = [f"sensors.pose_address=127.0.0.1:{poses}", "realtime.lock_memory=false", *settings]
        sets = [word for text in given for word in ("--set", text)]
        connect = f"udpin://127.0.0.1:{link}"
        program = [sys.executable, "-m", "flightapp.cli"]
        self.process = subprocess.Popen(
            [*program, "fly", str(directory / "mission.py"), "--connect", connect, "--out", str(self.out), *sets],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "COLUMNS": "1000"},
        )
        self.shift, self.confidence, self.tracking = np.zeros(3), None, True
        self.moments = []
        self._running, self._lock = True, threading.Lock()
        with ExitStack() as failed:
            failed.callback(self._end_application)
            config = load_config(None, {"sim.faults": faults}, given)
            track = load_track(directory / "track.toml")
            self._world = RemoteWorld(Order(config, track, 7, time.monotonic(), ("127.0.0.1", link)))
            failed.pop_all()
        self._threads = [threading.Thread(target=work) for work in (lambda: self._track(poses), self._watch)]
        for thread in self._threads:
            thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._running = False
        for thread in self._threads:
            thread.join()
        self._end_application()
        self._world.close()

    # What is done to it.

    def fault(self, name, value=None):
        """Let a fault of the simulated vehicle or its link happen; the time at which it had."""
        with self._lock:
            self._world.fault(name, value)
            return time.monotonic()

    def signal(self, number):
        """Send a signal to the application; the time of that."""
        now = time.monotonic()
        os.kill(self.process.pid, number)
        return now

    # What is seen of it.

    def until(self, true, seconds=PATIENCE):
        """Wait for ``true()``; the time of that."""
        deadline = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < deadline, f"it did not happen; {self.text()}"
            time.sleep(0.01)
        return time.monotonic()

    def until_event(self, words):
        """Wait until the application has logged something with ``words`` in it."""
        return self.until(lambda: any(words in text for text in self.events()))

    def until_down(self):
        """Wait until the vehicle has disarmed on the ground."""
        return self.until(lambda: not self.now.armed and self.now.height < 0.1)

    def flying(self):
        """Wait until the application has been in command for a moment."""
        self.until_event("takeoff: GOAL_ACHIEVED")
        time.sleep(0.5)
        assert self.now.mode == "OFFBOARD", self.text()
        return self

    @property
    def now(self):
        """The newest moment."""
        return self.moments[-1] if self.moments else Moment(0.0, "", False, np.zeros(3))

    def mode_since(self, mode, stamp):
        """s after ``stamp`` at which the armed vehicle was in ``mode`` for the first time; infinite if it was not."""
        flown = (moment for moment in self.moments if moment.armed and moment.stamp >= stamp)
        return next((moment.stamp - stamp for moment in flown if moment.mode == mode), np.inf)

    def statistics(self):
        """What has arrived at the vehicle's end of the link."""
        with self._lock:
            return self._world.statistics()

    def ended(self):
        """The application's exit status; waits for its end."""
        self.process.wait(PATIENCE)
        return self.process.returncode

    def said(self, word):
        """The numbers on the line that the mission printed after ``word``."""
        lines = (line.split() for line in self.text().splitlines())
        return next(([float(number) for number in line[1:]] for line in lines if line[:1] == [word]), None)

    def text(self):
        """All that the application printed."""
        return Path(self._output.name).read_text()

    def events(self):
        """What it has logged so far."""
        log = self.out / "app.log"
        return [json.loads(line)["event"] for line in log.read_text().splitlines()] if log.exists() else []

    def summary(self):
        """summary.json."""
        return json.loads((self.out / "summary.json").read_text())

    def assert_safe(self):
        """The vehicle is on the ground, disarmed, and has touched nothing."""
        with self._lock:
            state = self._world.state()
        assert not state.armed, self.text()
        assert abs(state.motion.position[2]) < 0.1, self.text()
        assert not [verdict for verdict in state.verdicts if isinstance(verdict, Collision)], self.text()

    # What keeps it going.

    def _track(self, port):
        """Hand the tracker's poses on, as they are or with the faults that were set."""
        self._world.poses.settimeout(0.1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while self._running:
                try:
                    record = np.frombuffer(self._world.poses.recv(256), POSE_RECORD)[0].copy()
                except TimeoutError:
                    continue
                record["position"] += self.shift
                if self.confidence is not None:
                    record["confidence"] = self.confidence
                if self.tracking:
                    sender.sendto(record.tobytes(), ("127.0.0.1", port))

    def _watch(self):
        while self._running:
            with self._lock:
                state = self._world.state()
                now = time.monotonic()
            self.moments.append(Moment(now, state.mode, state.armed, state.motion.position))
            time.sleep(0.02)

    def _end_application(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self._output.close()


def _lines(code):
    return "\n    ".join(code.strip().splitlines())


def _free_ports(count):
    probes = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()
