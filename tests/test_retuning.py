"""Gains that change in flight."""

import asyncio
import signal
from pathlib import Path

import numpy as np
import pytest

from flightapp import app
from flightapp.config import Config, load_config
from flightapp.control.flatness import FlatnessController
from flightapp.inputs import BadInputError
from flightapp.interfaces import Tunable
from flightapp.messages import RateCommand, VehicleState
from flightapp.recording.reader import read_flight
from flightapp.retuning import Retuner, changes, live_changes
from flightapp.trajectory import hover

ROOT = Path(__file__).parents[1]
MISSION = """
TRACK = "track.toml"
SETTINGS = {{"mission.takeoff_height": 1.0, "sim.camera": "corners"}}

async def mission(drone):
    await drone.takeoff()
    await drone.hover(1.0)
    {tuning}
    await drone.hover(1.0)
    await drone.land()
"""
HANGUP = (
    'import os, pathlib, signal; pathlib.Path("{path}").write_text("""{text}"""); os.kill(os.getpid(), signal.SIGHUP)'
)


def config(**control):
    return Config().model_copy(update={"control": Config().control.model_copy(update=control)})


def test_what_differs_is_told_in_order():
    found = changes(Config(), load_config(None, None, ("control.attitude_bandwidth=9", "vehicle.drag=[0.1, 0.1, 0.1]")))
    assert [(change.key, change.live) for change in found] == [
        ("vehicle.drag", False),
        ("control.attitude_bandwidth", True),
    ]


@pytest.mark.parametrize("text", ["control.rate=200", "control.controller=other", "vehicle.mass=1", "race.v_max=2"])
def test_what_others_were_built_with_may_not_change(text):
    other = load_config(None, None, (text, "control.yaw_bandwidth=2"))
    with pytest.raises(BadInputError, match=r"may not change in flight: " + text.split("=", maxsplit=1)[0]):
        live_changes(Config(), other)


LINE, HERE, LEVEL = (
    hover(0.0, np.array((0.0, 0.0, 1.2)), 0.0),
    np.array((0.3, 0.1, 1.0)),
    np.array((1.0, 0.0, 0.0, 0.0)),
)


def hovering(controller, stamp):
    state = VehicleState(stamp, HERE, LEVEL, np.zeros(3), np.zeros(3), np.zeros((9, 9)))
    return controller.command(stamp, state, LINE)


def test_a_controller_goes_on_with_all_its_gains_and_its_memory():
    softer = config(position_bandwidth=2.0, height_bandwidth=2.0)
    retuned, stiff, soft = FlatnessController(Config()), FlatnessController(Config()), FlatnessController(softer)
    assert isinstance(retuned, Tunable)
    for k in range(20):
        hovering(retuned, 0.004 * k), hovering(stiff, 0.004 * k), hovering(soft, 0.004 * k)
    retuner = Retuner(Config(), retuned, Config)
    assert retuner.apply(softer) == "control.position_bandwidth 4.0 → 2.0, control.height_bandwidth 4.5 → 2.0"
    after, of_stiff, of_soft = (hovering(c, 0.08) for c in (retuned, stiff, soft))
    assert abs(after.thrust - of_soft.thrust) < 0.3 * abs(of_stiff.thrust - of_soft.thrust)
    assert retuner.apply(softer) == "nothing has changed"


def test_one_bad_field_changes_nothing():
    controller = FlatnessController(Config())
    twin = FlatnessController(Config())
    retuner = Retuner(Config(), controller, Config)
    with pytest.raises(BadInputError, match=r"vehicle\.mass"):
        retuner.apply(load_config(None, None, ("control.position_bandwidth=8", "vehicle.mass=2")))
    one, other = hovering(controller, 0.0), hovering(twin, 0.0)
    assert one.thrust == other.thrust and np.array_equal(one.rates, other.rates)
    assert retuner.apply(config(position_bandwidth=8.0)).startswith("control.position_bandwidth")


def test_a_controller_that_cannot_is_left_alone():
    class Fixed:
        push = 0.0

        def reset(self):
            pass

        def command(self, stamp, state, trajectory):
            return RateCommand(stamp, np.zeros(3), 10.0)

    with pytest.raises(BadInputError, match="cannot be retuned"):
        Retuner(Config(), Fixed(), Config).apply(config(position_bandwidth=5.0))


def flown(tmp_path, *texts):
    """The log of a flight whose vehicle file becomes each of ``texts`` while it hovers, each told by SIGHUP."""
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text("[control]\nposition_bandwidth = 4.0\n")
    (tmp_path / "track.toml").write_text((ROOT / "missions" / "tracks" / "lemniscate.toml").read_text())
    tuning = "\n    await drone.hover(0.5)\n    ".join(HANGUP.format(path=vehicle, text=text) for text in texts)
    (tmp_path / "m.py").write_text(MISSION.format(tuning=tuning))
    before = signal.getsignal(signal.SIGHUP)
    ended = app.fly(app.FlightPlan(tmp_path / "m.py", tmp_path / "run", vehicle=vehicle))
    assert ended.ending.outcome == "GOAL_ACHIEVED", ended.ending
    assert signal.getsignal(signal.SIGHUP) is before
    return read_flight(tmp_path / "run" / "flight.mcap")


def test_a_hangup_retunes_a_flight_and_no_command_is_late(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(
        FlatnessController,
        "retune",
        lambda self, config, retune=FlatnessController.retune: (
            told.append((asyncio.get_running_loop().time(), config.control.position_bandwidth)),
            retune(self, config),
        )[1],
    )
    good = "[control]\\nposition_bandwidth = 5.0\\n"
    bad = "[control]\\nposition_bandwidth = -5.0\\n"
    flight = flown(tmp_path, good, bad, "[vehicle]\\nmass = 2.0\\n")
    events = [event for event in flight.events if event.kind == "tuning"]
    texts = [event.text for event in events]
    assert texts[0] == "retuned: control.position_bandwidth 4.0 → 5.0"
    assert texts[1].startswith("not retuned: ") and "control.position_bandwidth" in texts[1]
    assert texts[2].startswith("not retuned: may not change in flight: vehicle.mass 0.8 → 2.0")
    assert len(told) == 1 and told[0][1] == 5.0
    tick = 1.0 / Config().control.rate
    assert 0.0 <= events[0].stamp - told[0][0] < tick
    during = flight.commands.stamp[np.abs(flight.commands.stamp - told[0][0]) < 0.5]
    assert np.diff(during).max() < 1.01 * tick
