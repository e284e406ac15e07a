"""What is done to the vehicle, its link and its computer in a world in the same process."""

import asyncio
import errno
import math
from pathlib import Path

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.frames import quat_to_matrix
from flightapp.inputs import BadInputError
from flightapp.interfaces import AutopilotError, PlanningError
from flightapp.messages import FlightMode, RateCommand
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog
from flightapp.track import Gate, GateShape, Start, Track
from sim.clock import VirtualLoop
from sim.computer import DISK, FaultyWorker, SimComputer, hold_up, slow_down
from sim.faults import TIPPING, read_faults
from sim.px4.modes import NavState
from sim.rig import ModelledWorker, SimRig
from sim.world import World

TRACK = Track(name="pad", start=Start(position=(0.0, 0.0, 0.0)), waypoints=((1.0, 0.0, 1.0),))


def virtually(coroutine):
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(coroutine)


def world(*entries):
    """A world with faults, and what brings it to a time."""
    now = [0.0]
    made = World(Config(), TRACK, np.random.SeedSequence(3), lambda: now[0], read_faults(entries))

    def to(time):
        while now[0] < time - 1e-9:
            now[0] = min(now[0] + 0.005, time)
            made.advance()

    return made, to


def test_a_gust_blows_for_as_long_as_it_was_told_and_gusts_add_up():
    made, to = world((1.0, "gust", "3:4:1.0"), (1.5, "gust", "1:0:1.0"))
    blown = []
    for t in (0.9, 1.1, 1.6, 2.1, 2.6):
        to(t)
        blown.append(np.round(made.plant._constants[37:40] - made.plant.mean_wind, 6).tolist())
    assert blown == [[0, 0, 0], [3, 4, 0], [4, 4, 0], [1, 0, 0], [0, 0, 0]]


def test_a_tipped_vehicle_ends_upside_down_without_being_thrown_about():
    made, to = world((1.0, "tipped", 180.0))
    to(1.0 + TIPPING + 2.0)
    assert quat_to_matrix(made.plant.orientation)[2, 2] < -0.95
    assert np.linalg.norm(made.plant.velocity) < 0.05
    assert np.linalg.norm(made.plant.position) < 0.3


def test_a_battery_loses_its_charge_and_with_it_its_voltage():
    made, to = world((1.0, "battery", 0.1))
    to(0.9)
    full = made.plant.voltage
    to(1.1)
    assert made.autopilot.px4.battery == pytest.approx(0.1, abs=1e-3)
    assert made.plant.voltage < full - 1.0


def test_a_pilot_chooses_a_mode():
    made, to = world((3.0, "pilot", "POSCTL"))
    to(3.2)
    assert made.autopilot.status.latest.mode is FlightMode.POSITION


def test_a_silent_link_lets_nothing_through_and_commands_wait_for_it():
    async def fly():
        config = Config().model_copy(update={"sim": Config().sim.model_copy(update={"camera": "corners"})})
        faults = ((1.0, "link_silent", 1.0), (4.0, "link_silent", 9.0))
        rig = SimRig(config.model_copy(update={"sim": config.sim.model_copy(update={"faults": faults})}), TRACK, 0)
        loop, heard, felt = asyncio.get_running_loop(), [], []
        rig.autopilot.status.tap(lambda status: heard.append(status.stamp))
        rig.autopilot.imu.tap(lambda sample: felt.append(sample.stamp))
        await rig.autopilot.connect()

        async def poses():
            async for _ in rig.tracker.poses():
                pass

        going = asyncio.create_task(poses())
        await asyncio.sleep(1.2)
        rig.autopilot.send(RateCommand(loop.time(), np.zeros(3), 9.8))
        await rig.autopilot.land()
        answered = loop.time()
        await asyncio.sleep(4.5 - answered)
        with pytest.raises(AutopilotError, match="no answer"):
            await rig.autopilot.land()
        going.cancel()
        return answered, heard, felt

    answered, heard, felt = virtually(fly())
    assert answered == pytest.approx(2.0, abs=0.01)
    for stamps in (heard, felt):
        assert not [t for t in stamps if 1.01 < t < 1.99 or t > 4.01]
        assert [t for t in stamps if 2.0 < t < 3.9]


def test_a_driver_that_fails_raises():
    async def look():
        sim = Config().sim.model_copy(update={"faults": ((0.5, "task_failing", "camera"),), "camera": "corners"})
        rig = SimRig(Config().model_copy(update={"sim": sim}), TRACK, 0)
        async for frame in rig.camera.frames():
            seen["last"] = frame.stamp

    seen = {}
    with pytest.raises(RuntimeError, match="driver fails"):
        virtually(look())
    assert 0.4 < seen["last"] < 0.5


def test_a_worker_is_slow_and_its_plans_fail_as_told():
    faults = read_faults([(1.0, "compute_slow", 10.0), (2.0, "planner_failing", 1.0)])

    async def work():
        loop = asyncio.get_running_loop()
        worker = FaultyWorker(ModelledWorker(Config(), faults), faults, loop.time)
        assert await worker.run("plan", lambda: 7) == 7
        quick = loop.time()
        await asyncio.sleep(1.5 - loop.time())
        await worker.run("detection", lambda: None)
        slow = loop.time() - 1.5
        await asyncio.sleep(2.5 - loop.time())
        with pytest.raises(PlanningError):
            await worker.run("plan", lambda: 7)
        return quick, slow

    quick, slow = virtually(work())
    assert quick == pytest.approx(Config().compute.plan)
    assert slow == pytest.approx(10.0 * Config().compute.detection)
    assert slow_down(faults, 0.5) == 1.0


def test_an_event_loop_that_stalls_has_no_turn_meanwhile():
    async def tick():
        loop = asyncio.get_running_loop()
        hold_up(loop, read_faults([(0.5, "loop_stall", 0.3), (2.0, "loop_busy", 0.2)]))
        turns = []
        while loop.time() < 3.0:
            await asyncio.sleep(0.01)
            turns.append(loop.time())
        return np.array(turns)

    turns = virtually(tick())
    gaps = np.diff(turns)
    assert gaps.max() == pytest.approx(0.3, abs=0.02)
    assert 4 <= (gaps[(turns[1:] > 2.0) & (turns[1:] < 2.3)] > 0.025).sum() <= 6


def test_a_computer_has_a_disk_that_fills_and_a_clock_that_jumps():
    now = [0.0]
    computer = SimComputer(read_faults([(1.0, "disk_full", 5.0), (2.0, "clock_jump", -3.0)]), lambda: now[0])
    told = []
    for now[0] in (0.5, 1.5, 2.5):
        told.append((computer.disk_free(Path()), computer.clock_offset()))
    assert told == [(DISK, 0.0), (5.0, 0.0), (5.0, -3.0)]


def test_a_log_that_cannot_be_written_ends_the_record_and_nothing_else(tmp_path):
    now = [0.0]
    computer = SimComputer(read_faults([(1.0, "log_failing", 100.0)]), lambda: now[0])
    log = FlightLog(tmp_path / "flight.mcap", header={"seed": "1"}, create=computer.create)
    recorder = Recorder(log, threaded=False)
    for step in range(100):
        now[0] = 0.05 * step
        recorder._write("command", RateCommand(now[0], np.zeros(3), 9.8))
    assert recorder.error is not None
    assert recorder.error.errno == errno.ENOSPC
    assert recorder.refused == 0
    with pytest.raises(OSError, match="No space left"):
        recorder.close(outcome="landed")


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ((1.0, "gust", "3:4"), "3 numbers with colons"),
        ((1.0, "gust", "3:4:-1"), "0 s or more"),
        ((1.0, "battery", 1.5), "a share is 0 to 1"),
        ((1.0, "pilot", "UPSIDE"), "is no flight mode"),
        ((1.0, "task_failing", "wheel"), "none of camera, tracker"),
        ((1.0, "compute_slow", 0.0), "more than 0"),
        ((1.0, "batery", 0.1), "did you mean 'battery'"),
    ],
)
def test_what_cannot_be_done_is_an_error(entry, text):
    with pytest.raises(BadInputError, match=text):
        read_faults([entry])


def test_faults_last_as_long_as_they_say():
    lasting = read_faults([(1.0, "log_failing", 2.0), (1.0, "battery", 0.5), (1.0, "gust", "1:2:3")])
    assert sorted(fault.end for fault in lasting) == [3.0, 4.0, math.inf]


@pytest.mark.parametrize("x", [3.0, 4.0, 4.6])
def test_a_pilot_who_lands_flies_clear_of_a_frame_first(x):
    gate = Gate(id=1, position=(4.0, 0.0, 1.5), yaw_deg=0.0, markers=(0,))
    track = TRACK.model_copy(update={"gates": (gate,), "gate": GateShape(layout="top")})
    now, entries = [0.0], ((6.0, "pilot", "POSCTL"), (6.0, "pilot_lands", 1.0))
    made = World(Config(), track, np.random.SeedSequence(3), lambda: now[0], read_faults(entries))
    modes, hit = [], []
    made.truth.collisions.tap(hit.append)

    def to(time):
        while now[0] < time - 1e-9:
            now[0] += 0.005
            turned, moving = made.plant.orientation, made.plant.velocity
            made.px4.external_vision(now[0], made.plant.position, turned, moving, 0)
            made.advance()
            modes.append(made.px4.nav_state)

    made.plant._state[0] = x - 4.0  # the autopilot's takeoff leads over its frame's origin
    to(2.0)
    made.px4.set_global_origin()
    to(2.2)
    made.px4.parameters.set("MIS_TAKEOFF_ALT", 1.5)
    made.px4.takeoff()
    made.px4.arm()
    to(5.9)
    made.plant._state[0] += 4.0
    to(20.0)
    assert not made.px4.armed
    assert hit == []
    assert modes.index(NavState.POSCTL) < modes.index(NavState.AUTO_LAND)
    assert abs(made.plant.position[0] - 4.0) > 0.5
