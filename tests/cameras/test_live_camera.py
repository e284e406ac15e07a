"""A live camera: its thread, its loss and its return, and a stream over the loopback."""

import asyncio
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest
from fake_cameras import FakeDevice, noise

from flightapp.bus import Bus
from flightapp.cameras import live
from flightapp.cameras.choice import open_camera
from flightapp.cameras.live import LiveCamera
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.safety.faults import FaultKind, Stage
from flightapp.safety.monitor import Monitor, Readings
from flightapp.tasks import camera as camera_task


def config(*more):
    return load_config(None, None, ["camera.width=64", "camera.height=64", *more])


def camera_of(device, rate=100.0):
    return LiveCamera(device, config().camera.model(), rate)


def end(camera, device):
    """Close ``camera`` while its thread waits for an image."""
    device.film(FakeDevice.GONE)
    camera.close()


async def taken(frames):
    async with asyncio.timeout(3.0):
        return await anext(frames)


async def test_the_newest_frame_only():
    device = FakeDevice(noise())
    camera = camera_of(device)
    told = []
    camera.notices.tap(lambda event: told.append(event.text))
    frames = camera.frames()
    images = [noise() for _ in range(4)]
    begun = asyncio.get_running_loop().time()
    for image in images[:3]:
        device.film(image)
    first = asyncio.ensure_future(anext(frames))
    await asyncio.sleep(0)
    while not device.script.empty():
        time.sleep(0.001)  # noqa: ASYNC251 - the loop is held up while three arrive
    time.sleep(0.02)  # noqa: ASYNC251
    frame = await first
    np.testing.assert_array_equal(frame.image, images[2])
    assert begun <= frame.stamp <= asyncio.get_running_loop().time()
    device.film(images[3])
    following = await taken(frames)
    assert following.sequence == 3
    assert following.image.flags.c_contiguous
    assert (camera.counts.taken, camera.counts.skipped) == (4, 2)
    end(camera, device)
    assert "stamps are the driver's" in told[0]
    assert told[1] == "gain was refused"
    assert told[-1].startswith("4 images, 2 overtaken")


async def test_it_is_lost_and_comes_back(monkeypatch):
    monkeypatch.setattr(live, "BACK_OFF", 0.01)
    device = FakeDevice(noise(), absent=3)
    camera = camera_of(device)
    told = []
    camera.notices.tap(lambda event: told.append(event.text))
    frames = camera.frames()
    device.film(noise())
    first = await taken(frames)
    device.film(FakeDevice.GONE)
    device.film(last := noise())
    second = await taken(frames)
    np.testing.assert_array_equal(second.image, last)
    assert second.stamp > first.stamp
    assert camera.counts.reopened == 1
    assert device.attempts == 1 + 3 + 1
    assert any("unplugged; it is looked for" in text for text in told)
    assert "camera 'fake' is back" in told
    end(camera, device)
    assert not any(thread.name == "camera" for thread in threading.enumerate())
    assert device.closed >= 2


async def test_what_is_missing_damaged_or_stamped_wrong_is_counted():
    device = FakeDevice(noise())
    camera = camera_of(device)
    frames = camera.frames()
    now = time.monotonic()
    for image, stamp in (
        (noise(), now),
        (noise(), now + 0.01),
        (FakeDevice.DAMAGED, None),
        (noise(), now + 0.05),
        (noise(), now + 0.04),
        (noise(32, 32), now + 0.06),
        (final := noise(), now + 0.061),
    ):
        device.film(image, stamp)
    while not np.array_equal((await taken(frames)).image, final):
        pass
    assert (camera.counts.taken, camera.counts.missing, camera.counts.refused) == (4, 3, 3)
    end(camera, device)


async def test_another_size_than_the_calibrations_is_refused():
    device = FakeDevice(noise(128, 64))
    with pytest.raises(BadInputError, match=r"128 × 64 px.*64 × 64.*calibrate camera fake"):
        camera_of(device)
    assert device.closed == 1


async def test_health_sees_frames_and_their_absence():
    device = FakeDevice(noise())
    camera = camera_of(device)
    bus = Bus()
    rig = type("Rig", (), {"camera": camera})
    task = asyncio.create_task(camera_task(rig, bus))
    device.film(noise())
    async with asyncio.timeout(3.0):
        await bus.frame.next()
    monitor = Monitor(settings := config("safety.camera_timeout=0.1"), True)
    now = asyncio.get_running_loop().time()

    def faults(stamp):
        readings = Readings(stamp, Stage.PREFLIGHT, image_age=stamp - bus.frame.latest.stamp, images=bus.frame.count)
        return {fault.kind for fault in monitor.look(readings) if not fault.over}

    assert FaultKind.CAMERA_LOST not in faults(now)
    assert FaultKind.CAMERA_LOST in faults(now + settings.safety.camera_timeout + 0.3)
    task.cancel()
    end(camera, device)


@contextmanager
def stream(image_of, port=0):
    """A local MJPEG server; gives its port."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            try:
                while not ended.is_set():
                    jpeg = cv2.imencode(".jpg", image_of())[1].tobytes()
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    self.wfile.write(head.encode() + jpeg + b"\r\n")
                    time.sleep(0.01)
            except OSError:
                pass

        def log_message(self, *_):
            pass

    ended = threading.Event()
    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        ended.set()
        server.shutdown()
        server.server_close()
        thread.join()


async def test_a_stream_over_the_loopback_and_its_return(monkeypatch):
    monkeypatch.setattr(live, "BACK_OFF", 0.02)
    count = iter(range(10**9))

    def image():
        return np.full((64, 64), 10 * (next(count) % 20), np.uint8)

    with stream(image) as port:
        camera = open_camera(config(f"camera.source=http://127.0.0.1:{port}/x"))
        frames = camera.frames()
        first = [await taken(frames) for _ in range(3)]
        assert [frame.image.shape for frame in first] == [(64, 64)] * 3
        now = asyncio.get_running_loop().time()
        assert all(now - 2.0 < frame.stamp <= now for frame in first)
    with stream(lambda: np.full((64, 64), 255, np.uint8), port):
        async with asyncio.timeout(10.0):
            while (await anext(frames)).image.mean() < 250.0:
                pass
    assert camera.counts.reopened >= 1
    camera.close()


async def test_a_stream_that_is_not_there():
    with pytest.raises(BadInputError, match="nothing serves images there"):
        open_camera(config("camera.source=http://127.0.0.1:9/x"))


async def test_no_camera_is_configured():
    with pytest.raises(BadInputError, match=r"camera\.source is empty"):
        open_camera(config())
