"""A T265 by pyrealsense2 itself, with a camera that is played."""

import asyncio
import importlib.util
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.sensors import realsense
from flightapp.sensors.intake import PoseFault, PoseIntake
from flightapp.sensors.realsense import RealSensePoses

FAKE = Path(__file__).parent / "fake_t265" / "pyrealsense2.py"


@pytest.fixture
def camera(monkeypatch):
    spec = importlib.util.spec_from_file_location("pyrealsense2", FAKE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


def intake():
    return PoseIntake(load_config())


async def some(source, count):
    samples = source.poses()
    async with asyncio.timeout(10.0):
        got = [await anext(samples) for _ in range(count)]
    await samples.aclose()
    return got


async def test_poses_come_with_the_loops_stamps(camera):
    source = RealSensePoses(intake())
    got = await some(source, 5)
    now = asyncio.get_running_loop().time()
    source.close()
    np.testing.assert_allclose(got[0].position, (3.0, -0.1, 0.2), atol=0.05)
    np.testing.assert_allclose(got[0].velocity, (0.6, -0.4, 0.5))
    np.testing.assert_allclose(got[0].acceleration, (0.9, -0.7, 0.8))
    assert {sample.confidence for sample in got} == {2}
    assert np.all(np.diff([sample.stamp for sample in got]) > 0.0)
    assert 0.0 < now - got[-1].stamp < 0.5
    assert not camera.opened[0].running


async def test_only_the_newest_waits(camera):
    source = RealSensePoses(intake())
    samples = source.poses()
    first = await anext(samples)
    await asyncio.sleep(0.1)
    second = await anext(samples)
    source.close()
    assert second.stamp - first.stamp > 0.05


async def test_after_silence_it_is_opened_again_with_another_frame(camera, monkeypatch):
    monkeypatch.setattr(realsense, "SILENT", 0.05)
    monkeypatch.setattr(realsense, "RETRY", 0.05)
    camera.script["frames"] = 3
    source = RealSensePoses(intake())
    samples = source.poses()
    epochs = [(await anext(samples)).epoch for _ in range(3)]
    camera.script |= {"frames": 10_000, "absent": 2}
    async with asyncio.timeout(5.0):
        while epochs[-1] == 0:
            epochs.append((await anext(samples)).epoch)
    source.close()
    assert len(camera.opened) == 2
    assert epochs[-1] == 1


async def test_what_the_intake_refuses_does_not_come(camera, monkeypatch):
    lost = camera.pose_at(1)
    lost.tracker_confidence = 0
    monkeypatch.setattr(camera, "pose_at", lambda count: lost)
    source = RealSensePoses(intake())
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.1):
            await anext(source.poses())
    source.close()
    assert source.intake.refused[PoseFault.LOST] > 3


async def test_nothing_comes_after_closing(camera):
    source = RealSensePoses(intake())
    await some(source, 1)
    source.close()
    await asyncio.sleep(0.02)
    taken = source.intake.taken
    await asyncio.sleep(0.05)
    assert source.intake.taken == taken
    source.close()
    assert threading.active_count() < 20


@pytest.mark.parametrize("version", ["2.54.1", "2.55.1.6486", "3.0"])
async def test_a_version_that_no_longer_knows_it_is_named(camera, version):
    camera.__version__ = version
    with pytest.raises(BadInputError, match=version.replace(".", r"\.") + r".*2\.53\.1.*t265_bridge"):
        RealSensePoses(intake())


async def test_no_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(BadInputError, match=r"cannot be imported.*t265_bridge"):
        RealSensePoses(intake())


async def test_another_camera_or_none_is_named(camera):
    camera.names[:] = ["Intel RealSense D435I"]
    with pytest.raises(BadInputError, match=r"no T265.*D435I"):
        RealSensePoses(intake(), patience=0.0)
    camera.names.clear()
    with pytest.raises(BadInputError, match="no RealSense camera"):
        RealSensePoses(intake(), patience=0.0)


async def test_a_camera_that_does_not_open_is_told(camera):
    camera.script["absent"] = 1
    with pytest.raises(BadInputError, match="No device connected"):
        RealSensePoses(intake())
