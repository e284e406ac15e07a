"""Gains that change in flight."""

import asyncio
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightapp import app, tasks
from flightapp.bus import Bus
from flightapp.config import Config, load_config, with_settings
from flightapp.control import layout as at
from flightapp.control.baselines import PaperController, PdController
from flightapp.control.flatness import FlatnessController
from flightapp.inputs import BadInputError
from flightapp.interfaces import Tunable
from flightapp.messages import RateCommand, VehicleState
from flightapp.mission.orders import Orders
from flightapp.recording.reader import read_flight
from flightapp.retuning import Retuner, changes, live_changes, live_fields
from flightapp.trajectory import hover
from flightapp.worker import ThreadWorker

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


FIXED = ["control.rate=200", "control.controller=other", "control.without=['drag']", "vehicle.mass=1", "race.v_max=2"]


@pytest.mark.parametrize("text", FIXED)
def test_what_others_were_built_with_may_not_change(text):
    other = load_config(None, None, (text, "control.yaw_bandwidth=2"))
    with pytest.raises(BadInputError, match=r"may not change in flight: " + text.split("=", maxsplit=1)[0]):
        live_changes(Config(), other)


REST = np.zeros(3)
LINE, HERE, LEVEL = (
    hover(0.0, np.array((0.0, 0.0, 1.2)), 0.0),
    np.array((0.3, 0.1, 1.0)),
    np.array((1.0, 0.0, 0.0, 0.0)),
)


def hovering(controller, stamp):
    state = VehicleState(stamp, HERE + 0.3 * stamp, LEVEL, 0.5 * stamp + REST, REST, np.zeros((9, 9)))
    return controller.command(stamp, state, LINE)


@pytest.mark.parametrize("kind", [FlatnessController, PaperController, PdController])
def test_a_controller_goes_on_with_all_its_gains_and_forgets_nothing(kind):
    softer = config(position_bandwidth=2.0, height_bandwidth=2.0, attitude_bandwidth=5.0)
    retuned = kind(Config())
    assert isinstance(retuned, Tunable)
    for k in range(20):
        hovering(retuned, 0.004 * k)
    before = retuned._memory.copy()
    fresh = kind(softer)
    hovering(fresh, 0.0)
    gains = slice(at.PARAMETERS, at.STAMP)
    told = Retuner(Config(), retuned, Config).apply(softer)
    assert told.startswith("control.position_bandwidth 5.0 → 2.0, control.height_bandwidth 5.5 → 2.0, ")
    np.testing.assert_array_equal(retuned._memory[gains], fresh._memory[gains])
    np.testing.assert_array_equal(retuned._memory[at.STAMP :], before[at.STAMP :])
    # The next command is what the new gains make of the same memory, and a new line keeps them.
    fresh._memory[at.STAMP :] = before[at.STAMP :]
    one, other = hovering(retuned, 0.08), hovering(fresh, 0.08)
    assert one.thrust == other.thrust and np.array_equal(one.rates, other.rates)
    retuned.command(0.084, VehicleState(0.084, HERE, LEVEL, REST, REST, np.zeros((9, 9))), hover(0.0, HERE, 0.0))
    np.testing.assert_array_equal(retuned._memory[gains], fresh._memory[gains])


def test_what_an_observer_without_bandwidth_has_learnt_is_let_go():
    controller = FlatnessController(Config())
    for k in range(200):
        hovering(controller, 0.004 * k)
    assert controller.push > 0.0 and controller._memory[at.DRIFT : at.ORIGIN].any()
    trim = controller._memory[at.TRIM]
    controller.retune(config(disturbance_bandwidth=0.0, drift_bandwidth=0.0))
    assert controller.push == 0.0 and not controller._memory[at.DRIFT : at.ORIGIN].any()
    assert controller._memory[at.TRIM] == trim


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
        Retuner(Config(), Fixed(), Config).apply(config(position_bandwidth=6.0))


def test_what_may_change_is_listed_with_bounds_and_meaning():
    fields = {field.key: field for field in live_fields(config(yaw_bandwidth=2.5))}
    assert set(fields) == {
        f"control.{key}" for key in type(Config().control).model_fields if key not in ("controller", "rate", "without")
    }
    yaw = fields["control.yaw_bandwidth"]
    assert (yaw.value, yaw.bounds, yaw.description) == (2.5, "> 0.1, ≤ 20", "1/s, heading loop")


def retuner_of(tmp_path, text="[control]\nposition_bandwidth = 4.0\n"):
    file = tmp_path / "vehicle.toml"
    file.write_text(text)
    return Retuner(load_config(file), FlatnessController(load_config(file)), lambda: load_config(file)), file


def set_live(retuner, **settings):
    given = {key.replace("__", "."): value for key, value in settings.items()}
    return retuner.apply(retuner.propose(given), given)


def test_several_fields_are_set_at_once_or_none(tmp_path):
    retuner, _ = retuner_of(tmp_path)
    told = set_live(retuner, control__position_bandwidth="4.5", control__yaw_bandwidth="2")
    assert told == "control.position_bandwidth 4.0 → 4.5, control.yaw_bandwidth 3.0 → 2.0"
    before = retuner.config
    for key, value, why in [
        ("control.yaw_bandwith", "2", "did you mean 'yaw_bandwidth'"),
        ("controll.yaw_bandwidth", "2", "did you mean 'control'"),
        ("yaw_bandwidth", "2", "expected section.key"),
        ("control.yaw_bandwidth", "-2", "greater than 0.1"),
        ("control.yaw_bandwidth", "nan", "finite"),
        ("control.yaw_bandwidth", "fast", "valid number"),
        ("control.yaw_bandwidth", "[" * 900, "valid number"),
        ("control.yaw_bandwidth", "2\nother = 3", "valid number"),
        ("control.rate", "100", "may not change in flight: control.rate"),
        ("race.v_max", "1", "may not change in flight: race.v_max"),
        ("vehicle.mass", "2", "may not change in flight: vehicle.mass"),
    ]:
        given = {"control.height_bandwidth": "5", key: value}
        with pytest.raises(BadInputError, match=why):
            retuner.apply(retuner.propose(given), given)
        assert retuner.config is before


def test_what_was_set_in_flight_outlasts_a_reload_as_set_on_the_command_line_does(tmp_path):
    retuner, file = retuner_of(tmp_path)
    set_live(retuner, control__position_bandwidth="4.5")
    # The file does not count for what was set, and nothing of the file counts before it is read anew.
    file.write_text("[control]\nposition_bandwidth = 6.0\nyaw_bandwidth = 2.0\n")
    assert set_live(retuner, control__height_bandwidth="5") == "control.height_bandwidth 5.5 → 5.0"
    assert retuner.apply(retuner.propose(None)) == "control.yaw_bandwidth 3.0 → 2.0"
    control = retuner.config.control
    assert (control.position_bandwidth, control.height_bandwidth, control.yaw_bandwidth) == (4.5, 5.0, 2.0)
    # What was refused is forgotten.
    with pytest.raises(BadInputError):
        set_live(retuner, control__yaw_bandwidth="1", control__rate="100")
    assert retuner.apply(retuner.propose(None)) == "nothing has changed"


@pytest.mark.parametrize("vehicle", sorted((ROOT / "config").glob("*.toml")), ids=lambda path: path.stem)
def test_settings_change_nothing_but_themselves(vehicle):
    before = load_config(vehicle)
    assert with_settings(before, {}, "here") == before
    after = with_settings(before, {"control.yaw_bandwidth": "2.25"}, "here")
    assert [change.key for change in changes(before, after)] == ["control.yaw_bandwidth"]


async def retuned_by(load):
    """What the tuning task tells when it is asked once and ``load`` reads the configuration, and once more."""
    bus, worker = Bus(), ThreadWorker()
    rig, texts = SimpleNamespace(worker=worker), []
    with Orders() as orders:
        retuner = Retuner(Config(), FlatnessController(Config()), load)
        task = asyncio.ensure_future(tasks.tuning(rig, bus, retuner, orders))
        for _ in range(2):
            answer = orders.retune(None)
            texts.append((await asyncio.wait_for(bus.event.next(), 5.0)).text)
            with pytest.raises(BadInputError, match="not retuned"):
                answer.result(0)
        assert not task.done()
        task.cancel()
    worker.close()
    return texts


@pytest.mark.parametrize("kind", ["gone", "a directory", "no text", "too deep", "not ours to read"])
async def test_a_file_that_cannot_be_read_leaves_all_as_it_was_and_may_be_mended(tmp_path, monkeypatch, kind):
    file = tmp_path / "vehicle.toml"
    if kind == "a directory":
        file.mkdir()
    if kind == "no text":
        file.write_bytes(b"\xff\xfe\x00")
    if kind == "too deep":
        file.write_text("a = " + 5000 * "[" + 5000 * "]")
    if kind == "not ours to read":
        file.write_text("[control]\n")
        monkeypatch.setattr(Path, "read_text", unreadable)
    for text in await retuned_by(lambda: load_config(file)):
        assert text.startswith(f"not retuned: {file}: ")


def unreadable(*_args, **_keywords):
    raise PermissionError(13, "Permission denied")


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
