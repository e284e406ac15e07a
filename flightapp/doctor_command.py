"""Everything that a pilot must know before arming: the vehicle, its sensors and this computer, in one diagnosis."""

import asyncio
from collections.abc import Callable, Collection
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

from flightapp.autopilot import examination
from flightapp.autopilot.diagnosis import Diagnosis, Light, Line
from flightapp.autopilot.doctor import LISTEN, Confirm, DoctorLink, visit
from flightapp.autopilot.wanted_parameters import Profile
from flightapp.cameras.choice import open_camera
from flightapp.config import Config, Vehicle
from flightapp.inputs import BadInputError
from flightapp.preflight import camera, computer, poses
from flightapp.preflight.readings import read_computer
from flightapp.rigs import open_tracker
from flightapp.track import Start


class Part(StrEnum):
    """What can be examined by itself."""

    VEHICLE = "vehicle"
    """The autopilot behind its link."""
    POSES = "poses"
    CAMERA = "camera"
    COMPUTER = "computer"


def examine(
    config: Config,
    parts: Collection[Part],
    open_link: Callable[[Config], DoctorLink],
    profile: Profile,
    confirm: Confirm | None,
    runs: Path,
) -> Diagnosis:
    """Look at ``parts`` of the vehicle that ``config`` describes, and mend its parameters with ``confirm``.

    ``runs`` is where flights are recorded. Raises `BadInputError` where the link can't be opened.
    """
    diagnosis = Diagnosis(str(profile), (), ())
    if Part.VEHICLE in parts:
        diagnosis = visit(open_link, config, profile, confirm)
        settings = (_vehicle_file(config), *examination.consistency(config))
        diagnosis = replace(diagnosis, lines=(*diagnosis.lines, *settings))
    found: list[Line] = []
    if Part.POSES in parts:
        found += asyncio.run(_poses(config, LISTEN))
    if Part.CAMERA in parts:
        found += asyncio.run(_camera(config, LISTEN))
    if Part.COMPUTER in parts:
        found += computer.lines(read_computer(config, runs), config)
    return replace(diagnosis, lines=(*diagnosis.lines, *found))


def _vehicle_file(config: Config) -> Line:
    """What is wrong in a file ends the command before; this is whether there was one."""
    name, wanted = "vehicle", "this vehicle's own numbers"
    if config.vehicle != Vehicle():
        return Line(examination.CONFIGURATION, name, Light.GREEN, f"'{config.vehicle.name}', valid", wanted)
    mend = "give its file with --vehicle: identify thrust, lags and drag"
    return Line(examination.CONFIGURATION, name, Light.AMBER, "the default's: a simulated racer's", wanted, mend)


async def _poses(config: Config, seconds: float) -> list[Line]:
    if config.sensors.poses == "autopilot":
        return [Line(poses.POSES, "source", Light.GREEN, "the autopilot's own estimate: see its ODOMETRY")]
    try:
        tracker = open_tracker(config, Start(position=(0.0, 0.0, 0.0)))
    except BadInputError as error:
        return [Line(poses.POSES, "source", Light.RED, str(error), config.sensors.poses, "see section sensors")]
    try:
        return list(poses.lines(await poses.watch(tracker, seconds), config))
    finally:
        tracker.close()


async def _camera(config: Config, seconds: float) -> list[Line]:
    wanted = f"{config.camera.rate:g} Hz"
    if not config.camera.source:
        mend = "name it as camera.source; with waypoints alone it flies without, gates take one"
        return [Line(camera.CAMERA, "frames", Light.AMBER, "no camera is configured", wanted, mend)]
    try:
        source = open_camera(config)
    except BadInputError as error:
        return [Line(camera.CAMERA, "frames", Light.RED, str(error), wanted, "see section camera")]
    try:
        return list(camera.lines(await camera.watch(source, seconds), config, source.model))
    finally:
        source.close()
