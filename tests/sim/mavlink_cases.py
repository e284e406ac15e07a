"""A simulated vehicle behind a link on loopback, and a client that speaks to it with pymavlink's own codec."""

import asyncio
import contextlib
import math
import socket

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from flightapp.config import load_config
from flightapp.track import Start, Track
from sim.mavlink.endpoint import Link, MavlinkEndpoint
from sim.mavlink.streams import Profile
from sim.world import World

TRACK = Track(name="empty", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),))
VIO = 3
NAN21 = [math.nan] * 21


class Client:
    """A companion computer: system 1, component 191."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address = self._socket.getsockname()
        self.remote = None
        self.mav = dialect.MAVLink(None, 1, 191)
        self._parser = dialect.MAVLink(None)
        self.received = []
        self._arrived = asyncio.Event()
        asyncio.get_running_loop().add_reader(self._socket, self._take)

    def _take(self):
        with contextlib.suppress(BlockingIOError):
            while True:
                data, sender = self._socket.recvfrom(2048)
                self.remote = self.remote or sender
                self.received += self._parser.parse_buffer(data) or []
                self._arrived.set()

    def send(self, message):
        self._socket.sendto(message.pack(self.mav), self.remote)

    def send_bytes(self, data):
        self._socket.sendto(data, self.remote)

    def named(self, name):
        return [message for message in self.received if message.get_type() == name]

    async def wait(self, name, which=lambda message: True, patience=2.0):
        """The next message ``name``, from now on, that is ``which``."""
        seen = len(self.received)
        async with asyncio.timeout(patience):
            while True:
                for message in self.received[seen:]:
                    if message.get_type() == name and which(message):
                        return message
                seen = len(self.received)
                self._arrived.clear()
                await self._arrived.wait()

    async def command(self, code, *parameters, system=1, component=1, confirmation=0):
        """MAV_RESULT of a COMMAND_LONG."""
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        answer = asyncio.ensure_future(self.wait("COMMAND_ACK", lambda ack: ack.command == code))
        await asyncio.sleep(0)
        self.send(dialect.MAVLink_command_long_message(system, component, code, confirmation, *filled))
        return (await answer).result

    async def nothing(self, name, during=0.25):
        """Whether no message ``name`` comes."""
        try:
            await self.wait(name, patience=during)
        except TimeoutError:
            return True
        return False

    def setpoint(
        self, rates=(0.0, 0.0, 0.0), thrust=0.5, mask=128, system=1, component=1, q=(1.0, 0.0, 0.0, 0.0), sent=0
    ):
        self.send(dialect.MAVLink_set_attitude_target_message(sent, system, component, mask, q, *rates, thrust))

    def close(self):
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()


class Rig:
    """World, endpoint and client; the world is advanced in the background."""

    def __init__(self, profile=Profile.ONBOARD, remote=None):
        loop = asyncio.get_running_loop()
        self.client = Client()
        self.world = World(load_config(None, {}), TRACK, np.random.SeedSequence(0), loop.time)
        self.px4 = self.world.px4
        self.endpoint = MavlinkEndpoint(self.px4, loop.time, [Link(0, remote or self.client.address, profile)])
        self.offset = (0.0, 0.0, 0.0)
        self._tasks = []

    async def __aenter__(self):
        self.world.advance()
        await self.endpoint.start()
        self._tasks.append(asyncio.create_task(self._advance()))
        self.client.remote = self.endpoint.addresses[0]
        return self

    async def __aexit__(self, *error):
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.endpoint.close()
        self.client.close()

    async def _advance(self):
        while True:
            self.world.advance()
            await asyncio.sleep(0.004)

    def feed_vision(self):
        """Send the truth as external vision at 40 Hz from now on."""
        self._tasks.append(asyncio.create_task(self._feed()))

    async def _feed(self):
        while True:
            self.client.send(self.vision(offset=self.offset))
            await asyncio.sleep(0.025)

    def feed_inside(self):
        """Give the truth to the vehicle as external vision, past the link."""
        self._tasks.append(asyncio.create_task(self._feed_inside()))

    async def _feed_inside(self):
        loop, plant = asyncio.get_running_loop(), self.world.plant
        while True:
            now = loop.time()
            self.px4.external_vision(now, plant.position.copy(), plant.orientation.copy(), plant.velocity.copy())
            await asyncio.sleep(0.025)

    def vision(self, frame=1, child=12, estimator=VIO, scale=1.0, offset=(0.0, 0.0, 0.0), resets=0):
        """An ODOMETRY of the truth."""
        plant = self.world.plant
        x, y, z = (plant.position + offset).tolist()
        q = (plant.orientation * (scale, scale, -scale, -scale)).tolist()
        return dialect.MAVLink_odometry_message(
            0, frame, child, x, -y, -z, q, 0, 0, 0, 0, 0, 0, NAN21, NAN21, resets, estimator, 50
        )

    async def position(self, patience=4.0):
        """Feed vision until the vehicle has a local position that counts."""
        self.feed_vision()
        await until(lambda: self.px4.ready, patience)


async def until(condition, patience):
    """Wait until ``condition()``; raises `TimeoutError`."""
    for _ in range(round(patience / 0.02)):
        if condition():
            return
        await asyncio.sleep(0.02)
    raise TimeoutError
