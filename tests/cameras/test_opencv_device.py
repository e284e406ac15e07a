"""What is asked of a camera, what it refused, and how its images are stamped and turned to grey."""

import time
from itertools import pairwise

import cv2
import numpy as np
import pytest
from fake_cameras import FakeCapture, noise
from hypothesis import given
from hypothesis import strategies as st

from flightapp.cameras import names
from flightapp.cameras.names import Kind, Source, parse_source, video_devices
from flightapp.cameras.opencv import OpencvDevice, csi_pipeline, has_gstreamer
from flightapp.cameras.shots import CameraError, DamagedImageError, grey
from flightapp.config import Camera
from flightapp.inputs import BadInputError

VIDEO = Source("/dev/video7", Kind.V4L2)
SCENE = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (64, 96), np.uint8), (0, 0), 3.0)


def device(capture, **settings):
    wanted = {"width": 96, "height": 64, "rate": 60.0, "latency": 0.02, "driver_delay": 0.001, **settings}
    return OpencvDevice(VIDEO, Camera(**wanted), lambda *_: capture)


@pytest.mark.parametrize("code", ["YUYV", "GREY", "MJPG"])
def test_images_of_every_format_are_grey(code):
    camera = device(FakeCapture(SCENE), format=code)
    assert camera.open() == ()
    shot = camera.read()
    assert shot.image.shape == SCENE.shape
    assert shot.image.dtype == np.uint8
    assert shot.image.flags.c_contiguous
    assert np.abs(shot.image.astype(int) - SCENE).max() <= (6 if code == "MJPG" else 0)


def test_an_unknown_format_is_converted():
    camera = device(FakeCapture(SCENE, code="NV12"))
    camera.open()
    np.testing.assert_array_equal(camera.read().image, SCENE)


def test_drivers_stamps_are_used_where_they_are_by_our_clock():
    camera = device(FakeCapture(SCENE))
    camera.open()
    assert camera.hardware_stamps
    before = time.monotonic()
    shots = [camera.read() for _ in range(3)]
    assert before - 0.003 - 0.001 <= shots[0].stamp <= time.monotonic() - 0.003 - 0.001
    assert all(a.stamp < b.stamp for a, b in pairwise(shots))


@pytest.mark.parametrize("stamps", ["wall", "none"])
def test_else_images_are_stamped_on_arrival(stamps):
    camera = device(FakeCapture(SCENE, stamps=stamps))
    camera.open()
    assert not camera.hardware_stamps
    before = time.monotonic()
    assert before - 0.02 <= camera.read().stamp <= time.monotonic() - 0.02
    with pytest.raises(CameraError, match="CLOCK_MONOTONIC"):
        device(FakeCapture(SCENE, stamps=stamps), stamps="driver").open()


def test_arrival_can_be_asked_for():
    camera = device(FakeCapture(SCENE), stamps="arrival")
    camera.open()
    assert not camera.hardware_stamps


def test_what_the_driver_refuses_is_said():
    fixed = (cv2.CAP_PROP_FOURCC, cv2.CAP_PROP_FPS, cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_GAIN)
    capture = FakeCapture(SCENE, fixed=fixed)
    capture.values |= {cv2.CAP_PROP_FPS: 30.0, cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_GAIN: 7.0}
    refused = "; ".join(device(capture, format="MJPG", exposure=0.004, gain=20.0).open())
    for words in (
        "camera.format = MJPG was refused: it films YUYV",
        "films at 30 Hz",
        "40 was refused",
        "stays at 156",
    ):
        assert words in refused
    assert "camera.gain: 20" in refused


def test_what_the_driver_takes_is_set():
    capture = FakeCapture(SCENE)
    assert device(capture, format="MJPG", exposure=0.0025, gain=3.0).open() == ()
    assert capture.values[cv2.CAP_PROP_EXPOSURE] == 25.0
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    assert capture.values[cv2.CAP_PROP_GAIN] == 3.0
    assert device(automatic := FakeCapture(SCENE), auto_exposure=True).open() == ()
    assert automatic.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 3.0
    assert cv2.CAP_PROP_EXPOSURE not in automatic.values


def test_another_size_is_an_error_that_gives_the_camera_back():
    capture = FakeCapture(SCENE, size=(640, 480))
    with pytest.raises(CameraError, match=r"640 × 480.*camera\.width = 640"):
        device(capture).open()
    assert capture.released


def test_a_camera_that_is_not_there_names_those_that_are(tmp_path, monkeypatch):
    for name, words in (("video0", "Global Shutter"), ("video10", "Other"), ("video2", "Webcam")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "name").write_text(words + "\n", encoding="utf-8")
    assert video_devices(tmp_path) == ("/dev/video0 (Global Shutter)", "/dev/video2 (Webcam)", "/dev/video10 (Other)")
    monkeypatch.setattr(names.what_there_is, "__defaults__", (tmp_path,))
    with pytest.raises(CameraError, match="is not there; there are /dev/video0"):
        OpencvDevice(Source("/dev/video99", Kind.V4L2), Camera()).open()
    with pytest.raises(CameraError, match="cannot be opened"):
        device(FakeCapture(SCENE, opened=False)).open()


def test_a_jetsons_camera_needs_gstreamer():
    assert has_gstreamer("Video I/O:\n    GStreamer:                   YES (1.20.3)\n")
    assert not has_gstreamer("Video I/O:\n    GStreamer:                   NO\n")
    if not has_gstreamer():
        with pytest.raises(BadInputError, match="WITH_GSTREAMER=ON"):
            OpencvDevice(Source("csi:0", Kind.CSI), Camera())
    pipeline = csi_pipeline("csi:1", Camera(width=1280, height=720, rate=60.0, exposure=0.003, gain=4.0))
    for part in (
        "sensor-id=1",
        '"3000000 3000000"',
        '"4 4"',
        "width=1280, height=720",
        "framerate=60/1",
        "GRAY8",
        "drop=true",
    ):
        assert part in pipeline
    assert "exposuretimerange" not in csi_pipeline("csi:0", Camera(auto_exposure=True))
    opened = []
    csi = OpencvDevice(Source("csi:1", Kind.CSI), Camera(), lambda *a: opened.append(a) or FakeCapture(noise(640, 480)))
    assert csi.open() == ()
    assert opened[0][1] == cv2.CAP_GSTREAMER
    assert not csi.hardware_stamps
    assert csi.read().image.shape == (480, 640)


@given(st.binary(min_size=1, max_size=200), st.sampled_from(["MJPG", "YUYV", "GREY"]))
def test_damaged_images_are_refused(data, code):
    with pytest.raises(DamagedImageError):
        grey(np.frombuffer(data, np.uint8).reshape(1, -1), code, 16, 8 * 16 + 1)
    with pytest.raises(DamagedImageError):
        grey(np.zeros((0, 0), np.uint8), "", 16, 16)


def test_sources_are_told_apart(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "film.avi").write_bytes(b"x")
    (tmp_path / "log.mcap").write_bytes(b"x")
    for text, kind in {
        "/dev/video0": Kind.V4L2,
        "/dev/v4l/by-id/usb-Cam": Kind.V4L2,
        "csi:0": Kind.CSI,
        "http://127.0.0.1:8080/x": Kind.URL,
        "rtsp://10.0.0.2/1": Kind.URL,
        str(tmp_path / "images"): Kind.IMAGES,
        str(tmp_path / "film.avi"): Kind.VIDEO,
        str(tmp_path / "log.mcap"): Kind.LOG,
    }.items():
        assert parse_source(text).kind is kind
        assert parse_source(text).kind.live == (kind in (Kind.V4L2, Kind.CSI, Kind.URL))
    with pytest.raises(BadInputError, match="csi:N"):
        parse_source(str(tmp_path / "nowhere.avi"))
