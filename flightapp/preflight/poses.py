"""What a doctor looks at of the source of poses: rate, age, evenness, noise at rest, and what was refused.

`watch` collects samples of any `PoseSource`; the rest are pure functions of what came.
"""

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightapp.autopilot.diagnosis import Light, Line
from flightapp.config import Config
from flightapp.frames import Vector, quat_yaw, wrap_angle
from flightapp.interfaces import PoseSource

POSES = "poses"
GREEN, AMBER, RED = Light.GREEN, Light.AMBER, Light.RED
RATES = (30.0, 100.0)
"""Hz: below the first nothing flies, below the second it flies worse."""
OLD = 0.05
"""s from capture to arrival; the controller predicts as far, and the more the worse."""
STILL = 0.1
"""m/s, and as much of its way: faster is carried, and noise cannot be told."""
NOISE = 3.0
"""Times estimation.position_noise and velocity_noise."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What came of a tracker in a while, past the intake."""

    seconds: float
    stamps: Vector
    """(n,) s."""
    ages: Vector
    """(n,) s from each stamp to its arrival."""
    positions: Vector
    """(n, 3) m."""
    velocities: Vector
    """(n, 3) m/s."""
    turned: float
    """rad to the left, from the first to the last."""
    confidence: int
    """The least of them, 0 to 3."""
    told: str
    """The source's own account of what became of all samples."""


async def watch(source: PoseSource, seconds: float) -> Heard:
    """Listen to ``source`` for ``seconds``."""
    loop = asyncio.get_running_loop()
    samples, ages = [], []
    try:
        async with asyncio.timeout(seconds):
            async for sample in source.poses():
                samples.append(sample)
                ages.append(loop.time() - sample.stamp)
    except TimeoutError:
        pass
    stamps = np.array([sample.stamp for sample in samples])
    positions = np.array([sample.position for sample in samples]).reshape(-1, 3)
    velocities = np.array([sample.velocity for sample in samples]).reshape(-1, 3)
    turned = wrap_angle(quat_yaw(samples[-1].orientation) - quat_yaw(samples[0].orientation)) if samples else 0.0
    confidence = min((sample.confidence for sample in samples), default=0)
    return Heard(seconds, stamps, np.array(ages), positions, velocities, turned, confidence, source.report())


def lines(heard: Heard, config: Config) -> Iterator[Line]:
    """All of it."""
    wanted = f"{RATES[1]:g} Hz or more"
    if heard.stamps.size < 2:
        mend = f"start the tracker's bridge; sensors.poses is {config.sensors.poses}"
        if config.sensors.poses == "socket":
            mend += f", at {config.sensors.pose_address}"
        yield Line(POSES, "rate", RED, f"{heard.stamps.size} in {heard.seconds:g} s; {heard.told}", wanted, mend)
        return
    yield _rate(heard, wanted, config)
    yield _age(heard, config)
    if ": " in heard.told and "refused" in heard.told:
        yield Line(POSES, "intake", AMBER, heard.told, "nothing refused", "flightapp/sensors/intake.py tells of each")
    else:
        yield Line(POSES, "intake", GREEN, heard.told, "nothing refused")
    sure = heard.confidence >= 2
    mend = "" if sure else "light, and texture on walls and floor; move it about until it knows where it is"
    yield Line(POSES, "confidence", GREEN if sure else AMBER, f"{heard.confidence} of 3 at least", "2 or 3", mend)
    yield from _rest(heard, config)


def _rate(heard: Heard, wanted: str, config: Config) -> Line:
    gaps = np.diff(heard.stamps)
    rate = gaps.size / max(float(gaps.sum()), 1e-9)
    longest = float(gaps.max())
    found = f"{rate:.0f} Hz, longest wait {1e3 * longest:.0f} ms"
    if rate < RATES[0]:
        return Line(POSES, "rate", RED, found, wanted, "a tracker that is faster, or another link to it")
    if longest > config.safety.state_timeout:
        mend = "look at its cable and at the load: a flight would have landed (safety.state_timeout)"
        return Line(POSES, "rate", RED, found, wanted, mend)
    if rate < RATES[1]:
        return Line(POSES, "rate", AMBER, found, wanted, "fly slower: the gains were tuned for poses at 200 Hz")
    return Line(POSES, "rate", GREEN, found, wanted)


def _age(heard: Heard, config: Config) -> Line:
    age, oldest = float(np.median(heard.ages)), float(heard.ages.max())
    found, wanted = f"{1e3 * age:.1f} ms, at most {1e3 * oldest:.0f} ms", f"under {1e3 * OLD:g} ms"
    if age < 0.0:
        mend = "stamps must be of CLOCK_MONOTONIC of this computer; look at sensors.delay"
        return Line(POSES, "age", RED, found, wanted, mend)
    if age < OLD:
        return Line(POSES, "age", GREEN, found, wanted)
    light = RED if age > config.sensors.pose_max_age else AMBER
    return Line(POSES, "age", light, found, wanted, "look at the bridge: does it send each pose at once?")


def _rest(heard: Heard, config: Config) -> Iterator[Line]:
    """Noise of a vehicle that stands: what is left of the samples beside a straight line."""
    name, estimation = "noise at rest", config.estimation
    speed = float(np.linalg.norm(heard.velocities.mean(axis=0)))
    way = heard.positions[-1] - heard.positions[0]
    if speed > STILL or float(np.linalg.norm(way)) > STILL * heard.seconds:
        x, y, z = way.tolist()
        found = f"carried by x {x:+.2f}, y {y:+.2f}, z {z:+.2f} m, turned by {math.degrees(heard.turned):+.0f}°"
        mend = "put it down and ask again; x is ahead, y to the left, z up, and a turn to the left positive"
        yield Line(POSES, name, AMBER, found, "standing still", mend)
        return
    t = heard.stamps - heard.stamps.mean()
    slopes = t @ heard.positions / max(float(t @ t), 1e-12)
    rest = heard.positions - heard.positions.mean(axis=0) - t[:, None] * slopes
    position, velocity = float(rest.std(axis=0).max()), float(heard.velocities.std(axis=0).max())
    found = f"{1e3 * position:.1f} mm, {1e3 * velocity:.0f} mm/s"
    most = NOISE * estimation.position_noise, NOISE * estimation.velocity_noise
    wanted = f"under {1e3 * most[0]:.0f} mm, {1e3 * most[1]:.0f} mm/s"
    if position < most[0] and velocity < most[1]:
        yield Line(POSES, name, GREEN, found, wanted)
        return
    mend = "light and texture; damp its mount; or set estimation.position_noise and velocity_noise to what it has"
    yield Line(POSES, name, AMBER, found, wanted, mend)
