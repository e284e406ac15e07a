"""A calibration from images of a board finds the camera that took them, and says when it cannot."""

import json
import tomllib

import cv2
import numpy as np
import pytest
from board_images import BOARD, FISHEYE, PINHOLE, Photographer, pose, tour, view
from typer.testing import CliRunner

from flightapp import camera_calibration_command
from flightapp.calibration.coverage import Coverage, shortfalls
from flightapp.calibration.intrinsics import calibrate
from flightapp.calibration.lens_guess import ideal
from flightapp.camera_calibration_command import Chooser, calibrate_camera
from flightapp.cameras.shots import CameraError, Shot
from flightapp.commands.calibrate import calibrate as commands
from flightapp.config import Camera, load_config
from flightapp.inputs import BadInputError
from flightapp.messages import Frame

WITHIN = 0.005
"""Share by which fx, fy, cx and cy may be off."""


def views_of(model, rng, count, noise=0.1, **where):
    made = []
    while len(made) < count:
        one = view(model, *pose(model, rng, **where), rng, noise, str(len(made)))
        if one is not None:
            made.append(one)
    return made


def solved(model, views):
    return calibrate(model.lens, model.width, model.height, BOARD.corners, views)


@pytest.fixture(scope="module")
def photographer():
    return Photographer(PINHOLE)


@pytest.fixture(scope="module")
def pinhole_images(tmp_path_factory, photographer):
    folder = tmp_path_factory.mktemp("board")
    rng = np.random.default_rng(11)
    for i, (R, t) in enumerate(tour(PINHOLE, rng)):
        cv2.imwrite(str(folder / f"{i:03}.png"), photographer.take(R, t, rng))
    return folder


def test_a_pinhole_camera_from_a_directory_into_a_vehicle_file(pinhole_images, tmp_path):
    vehicle, out = tmp_path / "mine.toml", tmp_path / "new.toml"
    text = "# my drone\n[vehicle]\nname = 'mine'  # hers\n\n[camera]\nrate = 60.0  # Hz\n"
    vehicle.write_text(text, encoding="utf-8")
    files = ["--vehicle", str(vehicle), "--out", str(out), "--json", str(tmp_path / "r.json")]
    result = CliRunner().invoke(commands, ["camera", str(pinhole_images), *files])
    assert result.exit_code == 0, result.output
    told = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(told["focal"], PINHOLE.focal, rtol=WITHIN)
    assert told["shortfalls"] == []
    assert told["rms"] < 0.3
    off = np.abs(np.array(told["focal"]) - PINHOLE.focal)
    assert (off < 4.0 * np.array(told["deviation"][:4])).all()
    text = out.read_text(encoding="utf-8")
    for kept in ("# my drone", "name = 'mine'  # hers", "rate = 60.0  # Hz", "# calibrated: "):
        assert kept in text
    found = load_config(out).camera.model()
    np.testing.assert_allclose(found.focal, told["focal"], atol=1e-3)
    np.testing.assert_allclose(found.distortion, PINHOLE.distortion, atol=0.01)
    assert (found.width, found.height) == (480, 360)


def test_a_fisheye_camera_from_rendered_images():
    photographer, rng, chooser = Photographer(FISHEYE), np.random.default_rng(12), Chooser(BOARD, FISHEYE.lens)
    for i, (R, t) in enumerate(tour(FISHEYE, rng)):
        chooser.look(Frame(0.1 * i, i, photographer.take(R, t, rng)))
    result = chooser.solve()
    found = result.found
    assert result.shortfalls == ()
    np.testing.assert_allclose(found.model.focal, FISHEYE.focal, rtol=WITHIN)
    assert (np.abs(found.model.focal - FISHEYE.focal) < 4.0 * found.deviation[:4]).all()
    rays = FISHEYE.bearings(np.array(((60.0, 180.0), (240.0, 40.0), (400.0, 300.0))))
    np.testing.assert_allclose(found.model.project(rays), FISHEYE.project(rays), atol=0.5)


def test_images_that_are_all_alike_are_too_poor(tmp_path, photographer):
    rng = np.random.default_rng(13)
    for i in range(4):
        R, t = pose(PINHOLE, rng, (0.5, 0.5), tilt=0.1, distance=(0.28, 0.3))
        cv2.imwrite(str(tmp_path / f"{i}.png"), photographer.take(R, t, rng))
    out = tmp_path / "new.toml"
    result = CliRunner().invoke(commands, ["camera", str(tmp_path), "--out", str(out)])
    assert isinstance(result.exception, BadInputError)
    assert "that differ" in str(result.exception)
    assert not out.exists()


@pytest.mark.parametrize("model", [PINHOLE, FISHEYE])
def test_what_is_missing_is_said(model):
    rng = np.random.default_rng(3)
    distance = 0.12 if model.fisheye else 0.3
    views = views_of(model, rng, 20, place=(0.5, 0.5), tilt=0.12, distance=(distance, 1.05 * distance))
    found = solved(model, views)
    if found is not None:
        words = " ".join(shortfalls(BOARD, found))
        for part in ("left edge", "turned to the left, to the right", "nearer"):
            assert part in words
    assert shortfalls(BOARD, solved(model, [view(model, *p, rng, 0.1) for p in tour(model, rng, 30)])) == ()


def test_a_poor_result_is_written_by_force_alone(tmp_path, photographer):
    rng = np.random.default_rng(4)
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(7):
        place = (0.3 + 0.07 * i, 0.5)
        image = photographer.take(*pose(PINHOLE, rng, place, tilt=0.35, distance=(0.2, 0.4)), rng)
        cv2.imwrite(str(folder / f"{i}.png"), image)
    out = tmp_path / "new.toml"
    runner = CliRunner()
    result = runner.invoke(commands, ["camera", str(folder), "--out", str(out)])
    assert result.exit_code == 1
    assert "coverage too poor" in result.output
    assert "nothing was written" in result.output
    assert not out.exists()
    assert runner.invoke(commands, ["camera", str(folder), "--out", str(out), "--force"]).exit_code == 1
    assert tomllib.loads(out.read_text(encoding="utf-8"))["camera"]["width"] == 480


def test_views_that_do_not_fit_are_left_out():
    rng = np.random.default_rng(5)
    views = views_of(PINHOLE, rng, 25)
    for i in (3, 17):
        views[i].pixels[:] += rng.normal(0.0, 6.0, views[i].pixels.shape)
    views[8].pixels[2] += 40.0  # a single wrong corner
    found = solved(PINHOLE, views)
    assert {name for name, _ in found.rejected} >= {"3", "17"}
    np.testing.assert_allclose(found.model.focal, PINHOLE.focal, rtol=WITHIN)


@pytest.mark.parametrize("model", [PINHOLE, FISHEYE])
def test_standard_deviations_are_what_the_errors_are(model):
    scores = []
    for seed in range(3):
        rng = np.random.default_rng(100 + seed)
        found = solved(model, views_of(model, rng, 15, noise=0.2))
        scores.append((found.model.focal - model.focal) / found.deviation[:4])
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 1.9


def test_views_alike_are_not_taken_again():
    rng = np.random.default_rng(6)
    coverage = Coverage(BOARD, ideal(PINHOLE.lens, 480, 360, 265.0))
    R, t = pose(PINHOLE, rng, (0.5, 0.5))
    assert coverage.take(view(PINHOLE, R, t, rng))
    assert not any(coverage.take(view(PINHOLE, R, t + rng.normal(0.0, 0.001, 3), rng)) for _ in range(50))
    assert "views that differ" in coverage.told()
    before = coverage.missing()
    for R, t in tour(PINHOLE, rng, 40):
        coverage.take(view(PINHOLE, R, t, rng))
    assert coverage.missing() == ()
    assert before


def test_no_board_in_the_images(tmp_path):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((64, 64), 90, np.uint8))
    result = CliRunner().invoke(commands, ["camera", str(tmp_path)])
    assert "seen in 0 of 3 images" in str(result.exception)
    assert isinstance(CliRunner().invoke(commands, ["camera"]).exception, BadInputError)


class Filming:
    """A live camera that shows each of ``images`` twice: held still, then moved on."""

    def __init__(self, images):
        self.name, self.hardware_stamps, self.closed = "/dev/video0", True, False
        self._images = iter([image for one in images for image in (one, one)])
        self._count = 0

    def open(self):
        return ("camera.gain was refused",)

    def read(self):
        self._count += 1
        if (image := next(self._images, None)) is None:
            raise CameraError("it was unplugged")
        return Shot(image, 0.1 * self._count)

    def close(self):
        self.closed = True


def test_a_live_camera_is_guided_until_nothing_is_missing(pinhole_images, monkeypatch):
    images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(pinhole_images.iterdir())[::2]]
    filming = Filming(images)
    monkeypatch.setattr(camera_calibration_command, "OpencvDevice", lambda *_: filming)
    monkeypatch.setattr(camera_calibration_command, "TELL_EVERY", 0.0)
    told = []
    result = calibrate_camera("/dev/video0", Camera(), PINHOLE.lens, BOARD, 60.0, told.append)
    np.testing.assert_allclose(result.found.model.focal, PINHOLE.focal, rtol=WITHIN)
    assert filming.closed
    assert told[0] == "camera.gain was refused"
    assert any("still wanted: the board in the image's" in text for text in told)
    assert "unplugged" in told[-2] or "nothing is missing" in told[-1]


def test_a_moving_board_is_blurred_and_not_taken():
    rng = np.random.default_rng(9)
    chooser = Chooser(BOARD, PINHOLE.lens)
    photographer = Photographer(PINHOLE)
    R, t = pose(PINHOLE, rng, (0.5, 0.5), distance=(0.25, 0.3))
    for i in range(3):
        assert (
            chooser.look(Frame(0.0, i, photographer.take(R, t + np.array((0.01 * i, 0.0, 0.0)), rng)), 2.0) is not None
        )
    assert "no board" in chooser.told()
    chooser.look(Frame(0.0, 3, photographer.take(R, t + np.array((0.02, 0.0, 0.0)), rng)), 2.0)
    assert chooser.told().startswith("1 views")
