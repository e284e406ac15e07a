"""Directories, videos and flight logs as cameras."""

import asyncio

import cv2
import numpy as np
import pytest
from fake_cameras import noise
from fakes import virtually

from flightapp.cameras.choice import open_camera
from flightapp.cameras.names import parse_source
from flightapp.cameras.recordings import recorded_frames
from flightapp.cameras.replay import ReplayCamera
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Frame
from flightapp.recording.writer import FlightLog

SIZE = ["camera.width=64", "camera.height=64"]


def smooth(i):
    ramp = np.linspace(0.0, 200.0, 64)
    return np.clip(ramp[None, :] + 5.0 * i + ramp[:, None] * 0.2, 0, 255).astype(np.uint8)


def directory(path, stamps, euroc=True):
    folder = path / "data" if euroc else path
    folder.mkdir(parents=True)
    rows = ["#timestamp [ns],filename"]
    for i, stamp in enumerate(stamps):
        cv2.imwrite(str(folder / f"{stamp}.png"), smooth(i))
        rows.append(f"{stamp},{stamp}.png")
    (path / ("data.csv" if euroc else "timestamps.csv")).write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def read(path, rate=30.0):
    return list(recorded_frames(parse_source(str(path)), rate))


@pytest.mark.parametrize("euroc", [True, False])
def test_a_directory_with_stamps(tmp_path, euroc):
    stamps = [1403636579763555584 + round(1e9 * i / 20.0) for i in range(4)]
    frames = read(directory(tmp_path / "cam0", stamps, euroc))
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3]
    np.testing.assert_allclose(np.diff([frame.stamp for frame in frames]), 0.05, atol=1e-6)
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, smooth(i))
        assert frame.image.flags.c_contiguous


def test_a_directory_without_stamps_in_natural_order(tmp_path):
    for i in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"view{i}.png"), smooth(i))
    frames = read(tmp_path, 20.0)
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.05, 0.1])
    np.testing.assert_array_equal(frames[2].image, smooth(10))


def test_a_video(tmp_path):
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 64))
    for i in range(6):
        writer.write(cv2.cvtColor(smooth(i), cv2.COLOR_GRAY2BGR))
    writer.release()
    frames = read(path)
    assert len(frames) == 6
    np.testing.assert_allclose([frame.stamp for frame in frames], np.arange(6) / 25.0, atol=1e-3)
    for i, frame in enumerate(frames):
        assert frame.image.shape == (64, 64)
        assert np.abs(frame.image.astype(int) - smooth(i)).mean() < 6.0


def flight_log(path, stamps):
    log = FlightLog(path, header={"mission": "m", "seed": "0"}, opening=1.4)
    for i, stamp in enumerate(stamps):
        log.write("frame", Frame(stamp, i, smooth(i)))
    log.close()
    return path


def test_a_flight_log(tmp_path):
    frames = read(flight_log(tmp_path / "flight.mcap", [3.0, 3.1, 3.25]))
    assert [frame.stamp for frame in frames] == pytest.approx([3.0, 3.1, 3.25], abs=1e-6)
    assert np.abs(frames[1].image.astype(int) - smooth(1)).mean() < 3.0
    assert len(read(tmp_path)) == 3  # a run directory


def test_bad_recordings_say_what_is_wrong(tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    unordered = directory(tmp_path / "unordered", [2000, 1000, 3000])
    missing = directory(tmp_path / "missing", [1000, 2000])
    (missing / "data" / "2000.png").unlink()
    damaged = directory(tmp_path / "damaged", [1000, 2000])
    (damaged / "data" / "2000.png").write_bytes(b"no image")
    malformed = directory(tmp_path / "malformed", [1000])
    (malformed / "data.csv").write_text("#t,f\n1.5,a.png\n", encoding="utf-8")
    film = tmp_path / "film.mp4"
    film.write_bytes(b"no film")
    log = flight_log(tmp_path / "flight.mcap", [])
    for path, words in (
        (empty, "no images"),
        (unordered, "image 2 is stamped"),
        (missing, "there is no such image"),
        (damaged, "is no image"),
        (malformed, r"data\.csv:2: there must be a stamp in nanoseconds"),
        (film, "no video that FFmpeg can read"),
        (log, "recording.images"),
    ):
        with pytest.raises(BadInputError, match=words):
            read(path)


def replayed(stamps, latency=0.01, pause=0.0):
    """Stamps and arrivals on a virtual clock, of a consumer that takes ``pause`` s for each."""

    async def main():
        loop = asyncio.get_running_loop()
        frames = (Frame(stamp, i, noise()) for i, stamp in enumerate(stamps))
        camera = ReplayCamera(frames, load_config(None, None, SIZE).camera.model(), "test", latency)
        seen = []
        async for frame in camera.frames():
            seen.append((frame.stamp, loop.time(), frame.sequence))
            await asyncio.sleep(pause)
        return np.array(seen), camera.skipped

    return virtually(main())


def test_a_replay_keeps_its_pace_in_virtual_time():
    seen, skipped = replayed([100.0, 100.1, 100.25])
    np.testing.assert_allclose(seen[:, 0], (0.0, 0.1, 0.25), atol=1e-9)
    np.testing.assert_allclose(seen[:, 1], seen[:, 0] + 0.01, atol=1e-9)
    assert skipped == 0


def test_a_slow_consumer_gets_the_newest():
    seen, skipped = replayed(np.arange(10) / 10.0, pause=0.25)
    assert skipped == 10 - len(seen) > 0
    assert np.all(seen[:, 1] - seen[:, 0] < 0.12)


async def test_a_recording_as_the_configured_camera(tmp_path):
    path = directory(tmp_path / "cam0", [10**9 + round(1e7 * i) for i in range(3)])
    camera = open_camera(load_config(None, None, [*SIZE, f"camera.source={path}"]))
    assert [frame.sequence async for frame in camera.frames()] == [0, 1, 2]
    camera.close()
    with pytest.raises(BadInputError, match="64 × 64 px, but the calibration is for 640 × 480"):
        open_camera(load_config(None, None, [f"camera.source={path}"]))
