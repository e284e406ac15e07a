"""`flightapp calibrate mount` on logs and on images with a file of poses."""

import json
import math

import cv2
import numpy as np
import pytest
from board_images import BOARD, PINHOLE, Photographer
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from flightapp.commands.calibrate import calibrate as commands
from flightapp.config import dump_config, load_config
from flightapp.inputs import BadInputError
from flightapp.messages import MarkerDetection, PoseSample, Sightings
from flightapp.recording.writer import FlightLog
from flightapp.track import Gate, Start, Track

TRACK = Track(
    name="one",
    start=Start(position=(0.0, 0.0, 0.0)),
    gates=(Gate(id=4, position=(3.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3)),),
)
TRUE = {
    "camera.pitch_up_deg": 14.0,
    "camera.roll_deg": 1.5,
    "camera.yaw_deg": -2.0,
    "camera.position": [0.07, 0.01, 0.03],
}


def settings(values):
    return [f"{key}={value}" for key, value in values.items()]


def body(t, rng_phases):
    wave = np.sin(np.asarray(t)[:, None] * (1.1, 1.7, 1.3, 0.9, 1.2, 0.7) + rng_phases)
    return Rotation.from_euler("xyz", wave[:, :3] * (0.3, 0.25, 0.3)), wave[:, 3:] * (0.5, 0.4, 0.3) + (0.0, 0.0, 1.5)


def gate_log(path, seconds=20.0, axes=1.0):
    rng = np.random.default_rng(8)
    phases = rng.uniform(0.0, 6.0, 6)
    told = load_config(None, None, ["camera.pitch_up_deg=10.0"])
    true = load_config(None, None, settings(TRUE)).camera.model()
    header = {"mission": "m", "seed": "0", "track": TRACK.model_dump_json(), "config": dump_config(told)}
    log = FlightLog(path, header=header, opening=1.4)
    corners = TRACK.gate.marker_corners() + np.array((3.0, 0.0, 1.5))
    stamps = np.arange(0.0, seconds, 0.01)
    turns, places = body(stamps, phases)
    turns = Rotation.from_rotvec(axes * turns.as_rotvec())
    for i, (stamp, q, p) in enumerate(zip(stamps, turns.as_quat(scalar_first=True), places, strict=True)):
        log.write("pose", PoseSample(stamp, p, q, np.zeros(3), np.zeros(3), 3))
        if i % 20 == 0:
            R = turns[i]
            found = []
            for marker, quad in enumerate(corners):
                pixels = true.project((R.inv().apply(quad - p) - true.p_bc) @ true.R_bc)
                if true.contains(pixels).all():
                    found.append(MarkerDetection(marker, pixels + 0.2 * rng.standard_normal((4, 2))))
            log.write("sightings", Sightings(stamp, i, tuple(found), ()))
    log.close()
    return path


def test_a_flight_log_with_a_gate(tmp_path):
    log = gate_log(tmp_path / "flight.mcap")
    out, result_file = tmp_path / "new.toml", tmp_path / "r.json"
    result = CliRunner().invoke(commands, ["mount", str(log), "--out", str(out), "--json", str(result_file)])
    assert result.exit_code == 0, result.output
    told = json.loads(result_file.read_text(encoding="utf-8"))
    assert told["target"] == "gate 4 of one"
    camera = load_config(out).camera
    for key, value in TRUE.items():
        tolerance = 0.01 if "position" in key else 0.15
        assert getattr(camera, key.partition(".")[2]) == pytest.approx(value, abs=tolerance)


def test_too_poor_a_motion_writes_nothing(tmp_path):
    log = gate_log(tmp_path / "flight.mcap", axes=0.05)
    out = tmp_path / "new.toml"
    result = CliRunner().invoke(commands, ["mount", str(log), "--out", str(out)])
    assert result.exit_code == 1
    assert "turn it about two axes" in result.output
    assert not out.exists()


def test_images_of_a_board_with_the_trackers_poses(tmp_path):
    """The tracker sits elsewhere, is turned and late, as the vehicle file says."""
    rng, phases = np.random.default_rng(9), np.random.default_rng(9).uniform(0.0, 6.0, 6)
    lens = {
        "camera.width": 480,
        "camera.height": 360,
        "camera.focal": PINHOLE.focal.tolist(),
        "camera.distortion": PINHOLE.distortion.tolist(),
    }
    tracker = {
        "sensors.mount_position": [0.1, 0.0, 0.05],
        "sensors.mount_rpy_deg": [5.0, 10.0, 90.0],
        "sensors.delay": 0.03,
    }
    model = load_config(None, None, settings(lens | TRUE)).camera.model()
    photographer = Photographer(model)
    facing = np.array(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
    origin = np.array((0.34, 0.14, 1.68))

    def moved(t):
        R, p = body(t, phases)
        return Rotation.from_rotvec(0.8 * R.as_rotvec()), (p - (0.0, 0.0, 1.5)) * 0.1 + (0.0, 0.0, 1.5)

    rows = ["#timestamp [ns],filename"]
    (tmp_path / "data").mkdir()
    for i in range(18):
        stamp = 1.0 + 0.6 * i
        R, p = moved([stamp])
        R_cb = model.R_bc.T @ R[0].inv().as_matrix()
        image = photographer.take(R_cb @ facing, R_cb @ (origin - p[0]) - model.R_bc.T @ model.p_bc, rng)
        cv2.imwrite(str(tmp_path / "data" / f"{i}.png"), image)
        rows.append(f"{round(1e9 * stamp)},{i}.png")
    (tmp_path / "data.csv").write_text("\n".join(rows), encoding="utf-8")
    stamps = np.arange(0.0, 14.0, 0.01)
    R, p = moved(stamps)
    mount = Rotation.from_euler("ZYX", (90.0, 10.0, 5.0), degrees=True)
    q, arm = (R * mount).as_quat(), p + R.apply((0.1, 0.0, 0.05))
    poses = tmp_path / "poses.tum"
    np.savetxt(poses, np.column_stack((stamps + 0.03, arm, q)))
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(dump_config(load_config(None, None, settings(lens | tracker))), encoding="utf-8")
    out = tmp_path / "new.toml"
    arguments = ["mount", str(tmp_path), "--poses", str(poses), "--board", "--vehicle", str(vehicle), "--out", str(out)]
    result = CliRunner().invoke(commands, arguments)
    assert result.exit_code == 0, result.output
    camera = load_config(out).camera.model()
    turn = Rotation.from_matrix(camera.R_bc @ model.R_bc.T).magnitude()
    assert turn < math.radians(0.3)
    np.testing.assert_allclose(camera.p_bc, model.p_bc, atol=0.004)
    assert len(BOARD.corners) == 60


def test_what_is_missing_is_said(tmp_path):
    log = gate_log(tmp_path / "flight.mcap", seconds=1.0)
    runner = CliRunner()
    for arguments, words in (
        ([str(log), "--gate", "9"], "has the gates 4"),
        ([str(log), "--board", "--gate", "4"], "not both"),
        ([str(log), "--set", "camera.rate=20"], "--vehicle"),
        (["/dev/video0"], "is live"),
        ([str(tmp_path / "nowhere")], "no such file"),
    ):
        result = runner.invoke(commands, ["mount", *arguments])
        assert isinstance(result.exception, BadInputError)
        assert words in str(result.exception)
