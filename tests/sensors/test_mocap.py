"""Motion capture goes into the log as ground truth, and nowhere else."""

import ast
import asyncio
import dataclasses
import math
import socket
from pathlib import Path

import numpy as np
import pytest

import flightapp
from flightapp import app
from flightapp.bus import Bus
from flightapp.config import load_config
from flightapp.evaluation.summary import summarise
from flightapp.inputs import BadInputError
from flightapp.messages import GroundTruth, PoseSample
from flightapp.recording.reader import read_flight
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog
from flightapp.rigs import Px4Rig
from flightapp.sensors.mocap import MocapTruth
from flightapp.sensors.poses import encode_pose
from flightapp.timing import monotonic_origin
from flightapp.track import Gate, Start, Track

OPEN = Track(name="open", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),))
LEVEL = np.array((1.0, 0.0, 0.0, 0.0))


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def pose(stamp, x=0.0, confidence=3):
    return PoseSample(stamp, np.array((x, 0.0, 1.0)), LEVEL, np.array((1.0, 0.0, 0.0)), np.zeros(3), confidence)


async def settled():
    for _ in range(5):
        await asyncio.sleep(0.01)


async def test_every_good_pose_is_published_in_order_and_the_rest_is_left_out():
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    mocap, seen = MocapTruth(here), []
    mocap.feed.motion.tap(seen.append)
    origin = monotonic_origin(asyncio.get_running_loop())
    samples = [pose(1.0), pose(1.01, 0.1), pose(1.01, 9.0), pose(0.9, 9.0), pose(1.02, math.nan), pose(1.03, 9.0, 0)]
    for sample in (*samples, pose(1.04, 0.4)):
        there.send(encode_pose(sample, origin))
    there.send(b"hello")
    await settled()
    assert [type(truth) for truth in seen] == [GroundTruth] * 3
    assert [truth.position[0] for truth in seen] == [0.0, 0.1, 0.4]
    assert [truth.stamp for truth in seen] == pytest.approx([1.0, 1.01, 1.04], abs=1e-3)
    assert (mocap.counts.delivered, mocap.counts.malformed) == (3, 1)
    mocap.close()
    there.close()


async def test_a_real_vehicles_truth_reaches_the_log_and_not_its_tracker(tmp_path):
    port, truth = free_port(), tmp_path / "truth"
    settings = [f"link.connection=udpin://127.0.0.1:{port}", f"sensors.pose_address={tmp_path / 'poses'}"]
    config = load_config(None, None, [*settings, f"recording.truth_address={truth}"])
    rig, bus = Px4Rig(config, OPEN, 0), Bus()
    log = FlightLog(tmp_path / "flight.mcap", header={})
    recorder = Recorder(log, threaded=False)
    app._record(recorder, bus, rig, config)
    sent, steered = [], []
    rig.autopilot.send_pose = sent.append

    async def fly():
        steered.append(await anext(rig.tracker.poses()))

    flying = asyncio.create_task(fly())
    sender, origin = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM), monotonic_origin(asyncio.get_running_loop())
    now = asyncio.get_running_loop().time()
    for i in range(20):
        sender.sendto(encode_pose(pose(now + 0.001 * i, 0.1 * i), origin), str(truth))
        await asyncio.sleep(0)
    await settled()
    flying.cancel()
    recorder.close()
    await rig.autopilot.close()
    await rig.close()
    sender.close()
    assert not truth.exists()
    flight = read_flight(tmp_path / "flight.mcap")
    assert flight.truth.stamp.size == 20
    assert np.allclose(flight.truth.position[:, 0], 0.1 * np.arange(20))
    assert not (steered or sent or flight.poses.stamp.size or flight.states.stamp.size)
    assert all(topic.count == 0 for topic in vars(bus).values())


async def test_there_is_no_truth_unless_asked_for():
    rig = Px4Rig(load_config(None, None, [f"link.connection=udpin://127.0.0.1:{free_port()}"]), OPEN, 0)
    assert rig.truth is None
    await rig.autopilot.close()
    await rig.close()


def test_nothing_but_the_wiring_and_the_judges_names_a_rigs_truth():
    """Whoever reads an attribute called truth could fly by it: the wiring to the recorder, and what judges flights."""
    root = Path(flightapp.__file__).parent
    allowed = {"app.py", "rigs.py", "fault_command.py"}
    for file in root.rglob("*.py"):
        name = file.relative_to(root)
        if name.parts[0] in ("evaluation", "recording", "interchange") or str(name) in allowed:
            continue
        reads = [node for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, ast.Attribute)]
        assert not [node.lineno for node in reads if node.attr == "truth"], name


def test_an_address_elsewhere_is_refused():
    with pytest.raises(BadInputError, match=r"recording\.truth_address"):
        load_config(None, None, ["recording.truth_address=192.168.0.7:5601"])


def test_gates_are_judged_by_motion_capture_where_no_referee_is():
    """The truth goes through the gate as surveyed, 0.2 m left of its middle; the estimate would say otherwise."""
    from flightapp.evaluation.flight import Flight, Motions

    gate = Gate(id=1, position=(4.0, 0.0, 1.2), yaw_deg=0.0, markers=(1, 2, 3, 4))
    track = Track(name="gated", start=Start(position=(0.0, 0.0, 0.0)), gates=(gate,))
    stamp = np.linspace(0.0, 8.0, 801)
    path = np.column_stack((stamp, np.full(801, 0.2), np.full(801, 1.2)))
    rest = np.zeros((801, 3))
    truth = Motions(stamp, path, np.tile(LEVEL, (801, 1)), rest, rest)
    flight = Flight({"track": track.model_dump_json(), "config": ""}, truth=truth)
    (row,) = summarise(flight)["gates"]
    assert (row["passed"], row["time"], row["offset"]) == (True, 4.0, pytest.approx(0.2))
    away = dataclasses.replace(truth, position=path + np.array((0.0, 2.0, 0.0)))
    assert not summarise(dataclasses.replace(flight, truth=away))["gates"][0]["passed"]
