"""The live view: the log's topics over Foxglove's WebSocket, to be read only."""

import contextlib
import json
import re
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import recorded_messages as sample
from foxglove_client import Client

from flightapp.inputs import BadInputError
from flightapp.messages import AutopilotStatus, Frame
from flightapp.recording.live import BACKLOG, LOOPBACK, LiveServer, served
from flightapp.recording.reader import read_flight
from flightapp.recording.wire import FIXED
from flightapp.recording.writer import FlightLog

LAYOUT = Path(__file__).parents[2] / "config" / "foxglove_layout.json"


@pytest.fixture
def server():
    server = LiveServer("127.0.0.1:0", "test flight")
    yield server
    server.close()


@pytest.fixture
def log(server, tmp_path):
    log = FlightLog(tmp_path / "flight.mcap", header={}, context=server.context)
    yield log
    with contextlib.suppress(Exception):
        log.close()


def port(server):
    return int(server.url.rpartition(":")[2])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_a_client_gets_what_is_logged(server, log, rng, tmp_path):
    client = Client(port(server))
    info = client.until("serverInfo")
    assert info["name"] == "test flight"
    log.write("state", sample.state(rng, 0.0))
    channel = client.channels(["state", "/view/tf"])["state"]
    assert (channel["encoding"], channel["schemaName"]) == ("protobuf", "flightapp.VehicleState")
    client.subscribe([channel["id"]])
    sent, received = [], None
    deadline = time.monotonic() + 20.0
    while received is None and time.monotonic() < deadline:  # a subscription takes effect a moment later
        sent.append(sample.state(rng, 0.005 * (len(sent) + 1)))
        log.write("state", sent[-1])
        time.sleep(0.02)
        client._socket.settimeout(0.1)
        with contextlib.suppress(TimeoutError):
            received = client.data()
    assert received is not None
    _, stamp, payload = received
    message = next(state for state in sent if int(state.stamp * 1e9) == stamp)
    assert FIXED[type(message)].layout.columns([payload])["position"][0].tolist() == message.position.tolist()
    log.close()
    assert read_flight(tmp_path / "flight.mcap").states.stamp.size == len(sent) + 1
    client.close()


def test_clients_can_only_look(server, log, rng):
    client = Client(port(server))
    info = client.until("serverInfo")
    assert info["capabilities"] == []
    log.write("command", sample.command(rng, 0.0))
    client.send({"op": "advertise", "channels": [{"id": 7, "topic": "command", "encoding": "json", "schemaName": ""}]})
    assert client.until("status")["level"] > 0
    client.close()


def test_a_client_that_does_not_read_holds_nothing_up_and_loses_messages(server, log, rng, tmp_path):
    client = Client(port(server), receive_buffer=4096)
    image = rng.integers(0, 255, (240, 320), np.uint8)
    log.write("frame", Frame(0.0, 0, image))
    client.subscribe([client.channels(["/view/camera"])["/view/camera"]["id"]])
    time.sleep(0.3)
    count = 2 * BACKLOG
    writing = threading.Thread(target=lambda: [log.write("frame", Frame(0.01 * k, k, image)) for k in range(1, count)])
    writing.start()
    writing.join(60.0)
    assert not writing.is_alive()
    log.close()
    assert len(read_flight(tmp_path / "flight.mcap").pictures) == count
    client._socket.settimeout(1.0)
    got = 0
    with contextlib.suppress(TimeoutError, ConnectionError):
        while True:
            client.data()
            got += 1
    assert 0 < got < count
    client.close()


def test_the_default_is_for_this_computer_alone():
    assert LOOPBACK.startswith("127.0.0.1:")


@pytest.mark.parametrize("address", ["8765", "127.0.0.1:", "127.0.0.1:99999", "a b:c", "http://127.0.0.1:80"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(BadInputError, match="HOST:PORT"):
        LiveServer(address, "")


def test_an_address_in_use_is_told_before_anything_else():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(BadInputError, match="in use"), served(address, ""):
            pass


def test_without_an_address_nothing_is_served():
    with served("", "") as context:
        assert context is None


def test_the_layout_shows_topics_and_fields_that_are_logged(server, log, rng):
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    placed = set(re.findall(r'"([A-Za-z0-9]+![a-z0-9]+)"', json.dumps(layout["layout"])))
    assert placed == set(layout["configById"])
    sample.write_stream(log, 0.5)
    (status,) = (m for m in sample.irregular(rng, 0.5).values() if isinstance(m, AutopilotStatus))
    log.write("autopilot", status)
    log.write("frame", Frame(0.5, 1, np.zeros((48, 64), np.uint8)))
    client = Client(port(server))
    topics = set()
    with contextlib.suppress(TimeoutError):
        client._socket.settimeout(1.0)
        while True:
            message = client.receive()
            if isinstance(message, dict) and message["op"] == "advertise":
                topics |= {channel["topic"]: channel for channel in message["channels"]}.keys()
    used = set(re.findall(r'"(/view/[a-z]+)"', LAYOUT.read_text(encoding="utf-8")))
    paths = [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())]
    used |= {path.partition(".")[0] for path in paths}
    assert len(used) > 6
    assert used <= topics
    fields = {kind.__name__: set(fixed.layout.dtype.names) for kind, fixed in FIXED.items()}
    kinds = {"state": "VehicleState", "setpoint": "Setpoint", "command": "RateCommand", "truth": "GroundTruth"}
    for path in paths:
        topic, _, field = path.partition(".")
        if topic in kinds:
            assert field.partition("[")[0] in fields[kinds[topic]], path
    client.close()
