"""What the doctor says of a source of poses: one that is made up, sample by sample."""

import asyncio

import numpy as np
import pytest

from flightapp.autopilot.diagnosis import Light
from flightapp.config import Config, load_config
from flightapp.frames import quat_from_yaw
from flightapp.messages import PoseSample
from flightapp.preflight import poses

GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
GOOD = "poses: 600 taken, 0 relocalisations"


def heard(rate=200.0, age=0.008, noise=0.0005, speed=0.0, confidence=3, told=GOOD, gap=None):
    rng = np.random.default_rng(0)
    stamps = np.arange(0.0, 3.0, 1.0 / rate)
    if gap is not None:
        stamps = stamps[(stamps < 1.0) | (stamps >= 1.0 + gap)]
    n = stamps.size
    positions = rng.normal(0.0, noise, (n, 3)) + speed * stamps[:, None] * np.array((1.0, 0.0, 0.0))
    velocities = rng.normal(0.0, 10.0 * noise, (n, 3)) + np.array((speed, 0.0, 0.0))
    return poses.Heard(3.0, stamps, np.full(n, age), positions, velocities, 0.5, confidence, told)


def found(what, config=None):
    return {line.name: line for line in poses.lines(what, config or Config())}


def test_a_good_tracker_is_green():
    lines = found(heard())
    assert {line.light for line in lines.values()} == {GREEN}
    assert set(lines) == {"rate", "age", "intake", "confidence", "noise at rest"}


def test_a_slow_drift_is_no_noise():
    assert found(heard(speed=0.01))["noise at rest"].light is GREEN


@pytest.mark.parametrize(
    ("what", "name", "light", "told"),
    [
        (heard(rate=0.3), "rate", RED, "1 in 3 s"),
        (heard(rate=20.0), "rate", RED, "20 Hz"),
        (heard(rate=60.0), "rate", AMBER, "60 Hz"),
        (heard(gap=0.4), "rate", RED, "longest wait 4"),
        (heard(age=0.08), "age", AMBER, "80.0 ms"),
        (heard(age=0.5), "age", RED, "500.0 ms"),
        (heard(age=-0.003), "age", RED, "-3.0 ms"),
        (heard(told=f"{GOOD}; refused: jump 3"), "intake", AMBER, "jump 3"),
        (heard(confidence=1), "confidence", AMBER, "1 of 3"),
        (heard(noise=0.02), "noise at rest", AMBER, "mm"),
        (heard(speed=0.5), "noise at rest", AMBER, "carried by x +1.50"),
    ],
)
def test_what_is_wrong_is_told_with_its_mend(what, name, light, told):
    line = found(what)[name]
    assert line.light is light
    assert told in line.found
    assert line.mend


def test_where_nothing_comes_it_says_where_it_listens():
    line = found(heard(rate=0.1), load_config(None, None, ["sensors.pose_address=127.0.0.1:9999"]))["rate"]
    assert "127.0.0.1:9999" in line.mend


class FakeTracker:
    """A tracker that stands still, but for a turn to the left, a hundredth of a radian each time."""

    async def poses(self):
        loop, zero = asyncio.get_running_loop(), np.zeros(3)
        for count in range(10_000):
            await asyncio.sleep(0.005)
            yield PoseSample(loop.time() - 0.004, zero, quat_from_yaw(0.01 * count), zero, zero, 3)

    def report(self):
        return GOOD


async def test_a_tracker_is_listened_to():
    what = await poses.watch(FakeTracker(), 0.3)
    assert 5 < what.stamps.size <= 60
    assert (what.ages >= 0.004).all()
    assert what.positions.shape == what.velocities.shape == (what.stamps.size, 3)
    assert what.turned == pytest.approx(0.01 * (what.stamps.size - 1))
    assert (what.confidence, what.told) == (3, GOOD)
