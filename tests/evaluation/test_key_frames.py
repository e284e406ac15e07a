"""The images in the report: which are chosen, what is drawn, how large they get."""

import dataclasses

import cv2
import numpy as np
import pytest
import synthetic_flight as synthetic

from flightapp.config import Config, dump_config
from flightapp.evaluation.figures import Subject
from flightapp.evaluation.flight import Picture
from flightapp.evaluation.key_frames import LARGEST, MOST, chosen, key_frames
from flightapp.evaluation.metrics import racing_window
from flightapp.evaluation.report import report_html
from flightapp.evaluation.summary import flight_track, summarise
from flightapp.frames import quat_from_yaw
from flightapp.messages import Frame, GateSighting, MarkerDetection, Sightings
from flightapp.recording.reader import read_flight
from flightapp.recording.writer import FlightLog

CORNERS = np.array([(300.0, 200.0), (340.0, 200.0), (340.0, 240.0), (300.0, 240.0)])


def sighting(stamp, gate_id, distance, markers):
    position, level = np.array((distance, 0.0, 0.0)), np.array((1.0, 0.0, 0.0, 0.0))
    gate = GateSighting(stamp, gate_id, position, level, np.eye(6), None, markers, 0.2)
    return Sightings(stamp, 1, (MarkerDetection(4 * gate_id, CORNERS),), (gate,))


def jpeg(image):
    return cv2.imencode(".jpg", image)[1].tobytes()


def flight_with(pictures, sightings):
    flight = synthetic.flight()
    flight.header["config"] = dump_config(Config())
    return dataclasses.replace(flight, pictures=tuple(pictures), sightings=tuple(sightings))


def subject_of(flight):
    return Subject(flight, racing_window(flight), flight_track(flight))


GREY = np.full((480, 640), 128, np.uint8)


def test_each_gate_is_shown_with_most_markers_and_then_from_nearest():
    seen = [
        sighting(3.0, 1, 6.0, 4),
        sighting(3.5, 1, 4.0, 4),
        sighting(4.0, 1, 1.5, 2),
        sighting(4.2, 1, 2.0, 4),  # of which no image was kept
        sighting(5.0, 2, 3.0, 1),
    ]
    pictures = [Picture(stamp + 1e-9, jpeg(GREY)) for stamp in (3.0, 3.5, 4.0, 5.0)]
    reasons = chosen(flight_with(pictures, seen))
    assert sorted(reasons) == pytest.approx([3.5, 5.0])
    assert list(reasons.values()) == ["gate 1, 4 markers, 4.0 m away", "gate 2, 1 marker, 3.0 m away"]


def test_detected_markers_are_drawn_where_they_were_seen():
    (frame,) = key_frames(subject_of(flight_with([Picture(3.5, jpeg(GREY))], [sighting(3.5, 1, 4.0, 4)])))
    drawn = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    green = drawn[..., 1] - drawn[..., 2]
    assert green[220, 298:303].max() > 60
    assert green[220, 320] < 20
    assert frame.caption.startswith("1.50 s: gate 1")


def test_gates_are_drawn_where_the_map_has_them():
    flight = flight_with([Picture(6.0, jpeg(GREY))], [])
    gate = flight.maps[1].gates[1]
    states = flight.states
    away = gate.position - 4.0 * np.array((np.cos(gate.yaw), np.sin(gate.yaw), 0.0))
    states.position[:] = away
    states.orientation[:] = quat_from_yaw(gate.yaw)
    (frame,) = key_frames(subject_of(flight))
    drawn = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    camera = Config().camera.model()
    side = np.array((np.array((4.0, 0.5 * synthetic.track().gate.opening, 0.0)) - camera.p_bc) @ camera.R_bc)
    x, y = np.round(camera.project(side[None])[0]).astype(int)
    orange = drawn[..., 2] - drawn[..., 0]
    assert orange[y, x - 2 : x + 3].max() > 100
    assert abs(orange[y, x + 12]) < 40


def test_images_are_few_and_small():
    noise = np.random.default_rng(0).integers(0, 255, (600, 800), np.uint8)
    pictures = [Picture(2.0 + 0.1 * k, jpeg(noise)) for k in range(30)]
    frames = key_frames(
        subject_of(flight_with(pictures, [sighting(p.stamp, k, 3.0, 4) for k, p in enumerate(pictures)]))
    )
    assert len(frames) == MOST
    assert max(len(frame.jpeg) for frame in frames) <= 2 * LARGEST
    image = cv2.imdecode(np.frombuffer(frames[0].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (480, 640, 3)


def test_a_flight_without_images_has_no_such_section():
    bare, seeing = synthetic.flight(), flight_with([Picture(3.5, jpeg(GREY))], [])
    assert "What the camera saw" not in report_html(bare, summarise(bare))
    html = report_html(seeing, summarise(seeing))
    assert "What the camera saw" in html
    assert "no gate was seen" in html
    assert html.count("data:image/jpeg;base64,") == 1


def test_images_come_back_from_the_log_with_their_stamps(tmp_path):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={})
    image = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (48, 64), np.uint8), (9, 9), 3.0)
    for k in range(3):
        log.write("frame", Frame(0.1 * k, k, image))
    log.close()
    pictures = read_flight(path).pictures
    assert [picture.stamp for picture in pictures] == pytest.approx([0.0, 0.1, 0.2], abs=1e-8)
    read = cv2.imdecode(np.frombuffer(pictures[1].jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.abs(read.astype(int) - image.astype(int)).mean() < 3.0
