"""A client of Foxglove's WebSocket protocol, no more than the tests need, of the standard library alone."""

import base64
import json
import os
import socket
import struct
import time

SUBPROTOCOL = "foxglove.sdk.v1"
TEXT, BINARY, CLOSE = 1, 2, 8
MESSAGE = 1


class Client:
    """Connected to a server on this computer; ``receive_buffer`` bytes wait in the kernel at most."""

    def __init__(self, port, receive_buffer=None):
        self._socket = socket.socket()
        if receive_buffer is not None:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self._socket.settimeout(20.0)
        self._socket.connect(("127.0.0.1", port))
        self._buffer = b""
        key = base64.b64encode(os.urandom(16)).decode()
        lines = ["GET / HTTP/1.1", f"Host: 127.0.0.1:{port}", "Upgrade: websocket", "Connection: Upgrade"]
        lines += [f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {SUBPROTOCOL}"]
        self._socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        head = self._until(b"\r\n\r\n").decode().lower()
        assert " 101 " in head.partition("\r\n")[0]
        assert f"sec-websocket-protocol: {SUBPROTOCOL}" in head

    def receive(self):
        """The next message: a dictionary of a text, bytes of a binary one, None when the server closes."""
        payload = b""
        while True:
            first, second = self._take(2)
            length = second & 0x7F
            if length == 126:
                (length,) = struct.unpack(">H", self._take(2))
            elif length == 127:
                (length,) = struct.unpack(">Q", self._take(8))
            payload += self._take(length)
            kind = first & 0x0F
            if kind == CLOSE:
                return None
            if kind > CLOSE:
                payload = b""
                continue
            if first & 0x80:
                break
        return json.loads(payload) if payload[:1] == b"{" else payload

    def send(self, message):
        payload, mask = json.dumps(message).encode(), os.urandom(4)
        size = len(payload)
        head = struct.pack(">BB", 0x80 | TEXT, 0x80 | size) if size < 126 else struct.pack(">BBH", 0x81, 0xFE, size)
        self._socket.sendall(head + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload)))

    def until(self, operation):
        """The next text message of that operation."""
        while True:
            message = self.receive()
            assert message is not None, f"closed before {operation}"
            if isinstance(message, dict) and message["op"] == operation:
                return message

    def channels(self, wanted):
        """The advertised channels by topic, once all that are ``wanted`` are there."""
        found = {}
        while not set(wanted) <= found.keys():
            found |= {channel["topic"]: channel for channel in self.until("advertise")["channels"]}
        return found

    def subscribe(self, channel_ids):
        time.sleep(0.1)  # the server tells of a channel a moment before one can subscribe to it
        pairs = [{"id": number, "channelId": channel} for number, channel in enumerate(channel_ids, start=1)]
        self.send({"op": "subscribe", "subscriptions": pairs})

    def data(self):
        """Subscription, time in ns and payload of the next message's data."""
        while True:
            message = self.receive()
            assert message is not None
            if isinstance(message, bytes) and message[0] == MESSAGE:
                subscription, time = struct.unpack_from("<IQ", message, 1)
                return subscription, time, message[13:]

    def close(self):
        self._socket.close()

    def _take(self, count):
        while len(self._buffer) < count:
            received = self._socket.recv(1 << 16)
            if not received:
                raise ConnectionError("the server has gone")
            self._buffer += received
        taken, self._buffer = self._buffer[:count], self._buffer[count:]
        return taken

    def _until(self, end):
        while end not in self._buffer:
            self._buffer += self._socket.recv(4096)
        head, _, self._buffer = self._buffer.partition(end)
        return head
