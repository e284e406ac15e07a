"""The least that MAVSDK takes for a PX4: heartbeats and answers, scripted by a test."""

import os
import socket
import threading
import time

os.environ["MAVLINK20"] = "1"

from pymavlink.dialects.v20 import common as mavlink

OFFBOARD = 6 << 16
TAKEOFF = 4 << 16 | 2 << 24
LAND = 4 << 16 | 6 << 24
POSITION = 3 << 16


class Peer:
    """Runs in a thread from construction to `close`; `seen` are the messages that it was sent, by type.

    Its clock is ``ahead`` s ahead of this computer's.
    """

    def __init__(self, port, system=1):
        self.mode, self.armed, self.answers, self.texts = TAKEOFF, False, {}, {}
        self.silent = False
        self.ahead = 5.0
        self.seen = {}
        self.stamps = []
        self._remote = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.01)
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        self._lock = threading.Lock()
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, message):
        with self._lock:
            self._socket.sendto(message.pack(self._mav), self._remote)

    def count(self, name):
        return len(self.seen.get(name, ()))

    def last(self, name):
        return self.seen[name][-1]

    def heartbeat(self):
        base = 1 | (128 if self.armed else 0)
        self.send(mavlink.MAVLink_heartbeat_message(2, 12, base, self.mode, 3, 3))

    def close(self):
        self._running = False
        self._thread.join()
        self._socket.close()

    def _run(self):
        upcoming = 0.0
        while self._running:
            if time.monotonic() > upcoming:
                upcoming = time.monotonic() + 0.05
                if not self.silent:
                    self.heartbeat()
            try:
                data = self._socket.recv(4096)
            except TimeoutError:
                continue
            for message in self._mav.parse_buffer(data) or ():
                self.seen.setdefault(message.get_type(), []).append(message)
                if not self.silent:
                    self._answer(message)

    def _answer(self, message):
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            if message.command in self.texts:
                text = self.texts[message.command].encode()
                for k in range(len(text) // 50 + 1):  # in pieces, as PX4 does
                    self.send(mavlink.MAVLink_statustext_message(3, text[50 * k : 50 * k + 50], id=7, chunk_seq=k))
            result = self.answers.get(message.command, 0)
            self.send(mavlink.MAVLink_command_ack_message(message.command, result))
            if message.command == 400 and result == 0:
                self.armed = message.param1 == 1.0
            if message.command == 176 and result == 0:
                self.mode = int(message.param2) << 16 | int(message.param3) << 24
        elif kind == "TIMESYNC" and message.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(int(time.monotonic_ns() + 1e9 * self.ahead), message.ts1))
        elif kind in ("PARAM_SET", "PARAM_REQUEST_READ"):
            name = message.param_id
            value = getattr(message, "param_value", 2.5)
            self.send(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0))
