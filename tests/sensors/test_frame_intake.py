"""Frames of a camera that has frozen are told from those of one that lives."""

import numpy as np
import pytest

from flightapp.messages import Frame, MarkerDetection
from flightapp.sensors.frames import FrameIntake

RNG = np.random.default_rng(1)


def image(stamp):
    return Frame(stamp, int(30 * stamp), RNG.integers(80, 90, (480, 640)).astype(np.uint8))


def corners(stamp, count=1):
    markers = tuple(MarkerDetection(i, RNG.normal(size=(4, 2))) for i in range(count))
    return Frame(stamp, int(30 * stamp), None, markers)


def again(frame, stamp):
    copied = None if frame.image is None else frame.image.copy()
    return Frame(stamp, int(30 * stamp), copied, frame.markers)


@pytest.mark.parametrize("shot", [image, corners])
def test_an_image_is_used_once(shot):
    intake, first = FrameIntake(), shot(1.0)
    assert intake.take(first)
    assert [intake.take(again(first, stamp)) for stamp in (1.03, 1.07, 1.1)] == [False] * 3
    assert intake.take(shot(1.13))
    assert intake.repeated == 3


@pytest.mark.parametrize("shot", [image, corners])
def test_images_with_noise_are_all_used(shot):
    intake = FrameIntake()
    assert all(intake.take(shot(0.03 * i)) for i in range(30))
    assert not intake.notice


def test_frames_that_show_nothing_are_no_sign_of_a_frozen_camera_that_finds_markers_itself():
    intake = FrameIntake()
    assert all(intake.take(corners(0.03 * i, count=0)) for i in range(30))


def test_a_frozen_camera_is_told_of_once_and_again_when_it_lives():
    intake, first = FrameIntake(), image(1.0)
    told = []
    for i in range(30):
        intake.take(again(first, 1.0 + i / 30.0))
        told.append(intake.notice)
    assert [i for i, text in enumerate(told) if text] == [7]
    intake.take(image(2.0))
    assert "again" in intake.notice
    intake.take(image(2.03))
    assert not intake.notice


def test_an_image_of_another_size_is_another_image():
    intake = FrameIntake()
    assert intake.take(Frame(0.0, 0, np.zeros((48, 64), np.uint8)))
    assert intake.take(Frame(0.1, 1, np.zeros((48, 32), np.uint8)))
