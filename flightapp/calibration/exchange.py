"""Calibrations of other programs: OpenCV's YAML, read and written, and Kalibr's camchain.yaml, read."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from flightapp.calibration.lens_guess import NO_MOUNT
from flightapp.frames import Vector
from flightapp.inputs import BadInputError
from flightapp.perception.camera import CameraModel, Lens

KALIBR = {
    ("pinhole", "radtan"): Lens.PINHOLE,
    ("pinhole", "equidistant"): Lens.FISHEYE,
    ("pinhole", "none"): Lens.PINHOLE,
}
"""Kalibr's camera and distortion models (https://github.com/ethz-asl/kalibr/wiki/supported-models) that are ours."""


def to_opencv(model: CameraModel) -> str:
    """``model`` as the text of an OpenCV YAML file, with the names of OpenCV's own calibration sample."""
    storage = cv2.FileStorage(".yaml", cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
    storage.write("image_width", model.width)
    storage.write("image_height", model.height)
    storage.write("fisheye_model", int(model.fisheye))
    storage.write("camera_matrix", model.matrix)
    storage.write("distortion_coefficients", model.distortion.reshape(-1, 1))
    return str(storage.releaseAndGetString())


def read_calibration(path: Path, camera: str = "cam0") -> CameraModel:
    """The camera in an OpenCV YAML file, or ``camera`` of a Kalibr camchain.yaml; raises `BadInputError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: cannot be read: {error}") from None
    return _opencv(path, text) if text.startswith("%YAML") else _kalibr(path, text, camera)


def _opencv(path: Path, text: str) -> CameraModel:
    try:
        storage = cv2.FileStorage(text, cv2.FileStorage_READ | cv2.FileStorage_MEMORY)
        matrix = _matrix(storage, "camera_matrix", "cameraMatrix", "K")
        distortion = _matrix(storage, "distortion_coefficients", "distCoeffs", "D")
    except (cv2.error, SystemError):  # OpenCV's error may be wrapped
        raise BadInputError(f"{path}: is no YAML that OpenCV can read") from None
    width, height = (_integer(storage, *names) for names in (("image_width", "width"), ("image_height", "height")))
    if matrix is None or matrix.shape != (3, 3) or distortion is None or not width or not height:
        raise BadInputError(
            f"{path}: an OpenCV calibration needs image_width, image_height, camera_matrix (3 × 3) and"
            " distortion_coefficients"
        )
    fisheye = bool(_integer(storage, "fisheye_model"))
    coefficients = distortion.ravel()
    rest = coefficients[4:]
    if len(coefficients) < 4 or (rest != 0.0).any():
        raise BadInputError(
            f"{path}: four coefficients are known here (k1, k2, p1, p2, or a fisheye's k1 to k4), and the file has"
            f" {len(coefficients)} that count; calibrate with flightapp calibrate camera, or fix the others at 0"
        )
    focal = np.array((matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]))
    return _checked(path, Lens.FISHEYE if fisheye else Lens.PINHOLE, width, height, focal, coefficients[:4])


def _matrix(storage: Any, *names: str) -> Vector | None:
    for name in names:
        matrix = storage.getNode(name).mat()
        if matrix is not None:
            return np.asarray(matrix, float)
    return None


def _integer(storage: Any, *names: str) -> int:
    for name in names:
        node = storage.getNode(name)
        if node.isInt() or node.isReal():
            return int(node.real())
    return 0


def _kalibr(path: Path, text: str, camera: str) -> CameraModel:
    try:
        chain = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise BadInputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    if not isinstance(chain, dict) or not isinstance(chain.get(camera), dict):
        known = ", ".join(map(str, chain)) if isinstance(chain, dict) else "nothing"
        raise BadInputError(
            f"{path}: there is no '{camera}', in a Kalibr camchain or else: there is {known}; name one with --camera"
        )
    told = chain[camera]
    kind = told.get("camera_model"), told.get("distortion_model")
    if kind not in KALIBR:
        models = ", ".join(" / ".join(names) for names in KALIBR)
        raise BadInputError(f"{path}: {camera} is {kind[0]} / {kind[1]}; known here are {models}")
    numbers = {"intrinsics": 4, "distortion_coeffs": 4, "resolution": 2}
    if kind[1] == "none":
        told = {**told, "distortion_coeffs": [0.0] * 4}
    values = {}
    for key, count in numbers.items():
        try:
            values[key] = np.array(told.get(key), float).reshape(count)
        except (TypeError, ValueError):
            raise BadInputError(f"{path}: {camera}.{key} must be {count} numbers, not {told.get(key)!r}") from None
    width, height = (int(side) for side in values["resolution"])
    return _checked(path, KALIBR[kind], width, height, values["intrinsics"], values["distortion_coeffs"])


def _checked(path: Path, lens: Lens, width: int, height: int, focal: Vector, distortion: Vector) -> CameraModel:
    if not (np.isfinite(focal).all() and np.isfinite(distortion).all() and focal[0] > 0.0 and focal[1] > 0.0):
        raise BadInputError(f"{path}: focal lengths must be positive and all numbers finite")
    if not (0.0 < focal[2] < width and 0.0 < focal[3] < height):
        raise BadInputError(f"{path}: the principal point, {focal[2]:g}, {focal[3]:g}, is not in the image")
    return CameraModel(lens, width, height, focal, distortion, *NO_MOUNT)
