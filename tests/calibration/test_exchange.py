"""Calibrations of other programs, and vehicle files that keep what they have."""

import cv2
import numpy as np
import pytest
from board_images import FISHEYE, PINHOLE
from typer.testing import CliRunner

from flightapp.calibration.exchange import read_calibration, to_opencv
from flightapp.calibration.settings_file import camera_settings, with_settings
from flightapp.commands.calibrate import calibrate as commands
from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.perception.camera import Lens

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.0082, 0.0412, -0.0383, 0.0066]
  distortion_model: equidistant
  intrinsics: [285.1, 286.2, 420.3, 400.4]
  resolution: [848, 800]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
cam2: {camera_model: omni, distortion_model: radtan}
cam3: {camera_model: pinhole, distortion_model: radtan, intrinsics: [1, 2], distortion_coeffs: [0, 0, 0, 0]}
"""


@pytest.mark.parametrize("model", [PINHOLE, FISHEYE])
def test_opencvs_yaml_leads_back(tmp_path, model):
    path = tmp_path / "camera.yaml"
    path.write_text(to_opencv(model), encoding="utf-8")
    found = read_calibration(path)
    assert (found.lens, found.width, found.height) == (model.lens, model.width, model.height)
    np.testing.assert_allclose(found.focal, model.focal)
    np.testing.assert_allclose(found.distortion, model.distortion)


def test_opencvs_yaml_with_more_coefficients(tmp_path):
    path = tmp_path / "camera.yaml"

    def written(*more):
        storage = cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
        storage.write("image_width", 480)
        storage.write("image_height", 360)
        storage.write("camera_matrix", PINHOLE.matrix)
        storage.write("distortion_coefficients", np.array([[*PINHOLE.distortion, *more]]))
        storage.release()
        return path

    np.testing.assert_allclose(read_calibration(written(0.0)).distortion, PINHOLE.distortion)
    with pytest.raises(BadInputError, match="four coefficients"):
        read_calibration(written(0.1))


def test_kalibrs_chain(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR, encoding="utf-8")
    fisheye, pinhole = read_calibration(path), read_calibration(path, "cam1")
    assert (fisheye.lens, fisheye.width, fisheye.height) == (Lens.FISHEYE, 848, 800)
    np.testing.assert_allclose(fisheye.focal, (285.1, 286.2, 420.3, 400.4))
    assert pinhole.lens is Lens.PINHOLE
    np.testing.assert_allclose(pinhole.distortion, (-0.28, 0.07, 0.0002, 0.00002))
    wrong = {"cam2": "omni / radtan", "cam3": r"cam3\.intrinsics must be 4", "cam9": "there is cam0, cam1"}
    for camera, words in wrong.items():
        with pytest.raises(BadInputError, match=words):
            read_calibration(path, camera)


@pytest.mark.parametrize("text", ["", "x", "- 1", "cam0: [", "%YAML:1.0\n---\na: 1\n", "%YAML:1.0\n---\n\t{"])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "x.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInputError, match=r"x\.yaml"):
        read_calibration(path)


def test_the_commands_take_over_and_hand_on(tmp_path):
    (tmp_path / "camchain.yaml").write_text(KALIBR, encoding="utf-8")
    runner = CliRunner()
    out, yaml = tmp_path / "mine.toml", tmp_path / "cv.yaml"
    assert runner.invoke(commands, ["import", str(tmp_path / "camchain.yaml"), "--out", str(out)]).exit_code == 0
    assert load_config(out).camera.lens is Lens.FISHEYE
    assert runner.invoke(commands, ["export", str(out), str(yaml)]).exit_code == 0
    np.testing.assert_allclose(read_calibration(yaml).focal, (285.1, 286.2, 420.3, 400.4))


CAMERA = "[camera]\nfocal = [1.0, 2.0, 3.0, 4.0] # px\nrate = 50.0\n"


@pytest.mark.parametrize("text", ["", "# only a comment\n", CAMERA, "[race]\nv_max = 2.0\n"])
def test_settings_go_into_any_file(text):
    settings = camera_settings(FISHEYE)
    once = with_settings(text, "camera", settings, "calibrated", "x")
    assert with_settings(once, "camera", settings, "calibrated", "x") == once
    for line in text.splitlines():
        if "focal" not in line:
            assert line in once
    assert ("# px" in once) == ("# px" in text)


def test_what_is_no_toml_is_refused():
    with pytest.raises(BadInputError, match=r"mine\.toml: not valid TOML"):
        with_settings("[camera\n", "camera", {}, "", "mine.toml")
    with pytest.raises(BadInputError, match="must be a table"):
        with_settings("camera = 3\n", "camera", {"a": 1}, "", "mine.toml")
