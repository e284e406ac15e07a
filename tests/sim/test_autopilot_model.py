"""The model of PX4 behind the interface that the application flies by."""

import math

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.frames import GRAVITY, quat_from_euler
from flightapp.interfaces import AutopilotError
from flightapp.messages import FlightMode, PoseSample, RateCommand
from sim import layout as at
from sim.autopilot import SimAutopilot
from sim.plant import Plant
from sim.vehicles import load_vehicle

HEIGHT = 1.5


class Bench:
    """An autopilot, its vehicle and a clock that moves when told."""

    def __init__(self, name="racer", seed=1, **world):
        self.now = 0.0
        vehicle = load_vehicle(name)
        config = load_config(overrides=[f"vehicle.hover_thrust={vehicle.hover_thrust}"])
        self.plant = Plant(vehicle, seed, **world)
        self.autopilot = SimAutopilot(config, self.plant, seed, lambda: self.now)
        self.seen = []
        self.autopilot.status.tap(self.seen.append)

    def do(self, name, *args):
        call = getattr(self.autopilot, name)(*args)
        with pytest.raises(StopIteration):
            call.send(None)

    def see(self):
        row = self.plant.state_at(self.now)
        self.autopilot.send_pose(PoseSample(self.now, row[1:4], row[4:8], row[8:11], row[11:14], 3))

    def fly(self, seconds, send=None, piece=0.004, see=True):
        end = self.now + seconds
        while self.now < end - 1e-9:
            if see:
                self.see()
            if send is not None:
                self.autopilot.send(RateCommand(self.now, np.array(send[:3]), send[3]))
            self.now = min(self.now + piece, end)
            self.autopilot.advance(self.now)

    def airborne(self):
        self.prepare()
        self.do("takeoff", HEIGHT)
        self.do("arm")
        self.fly(6.0)
        return self

    def prepare(self):
        self.fly(1.2)
        assert self.autopilot.status.latest.ready

    @property
    def mode(self):
        return self.autopilot.status.latest.mode

    @property
    def armed(self):
        return self.autopilot.status.latest.armed


@pytest.mark.parametrize("name", ["px4", "iris", "f330", "racer", "limits"])
def test_it_takes_off_holds_lands_and_disarms(name):
    bench = Bench(name).airborne()
    assert bench.mode is FlightMode.TAKEOFF
    assert not bench.autopilot.status.latest.landed
    assert bench.plant.position[2] == pytest.approx(HEIGHT, abs=0.25)
    bench.do("land")
    bench.fly(6.0)
    assert not bench.armed
    assert bench.autopilot.status.latest.landed
    assert bench.mode is FlightMode.TAKEOFF
    assert bench.plant.on_ground
    assert np.all(bench.plant.rotor_speeds == 0.0)
    climbs = np.diff([s.stamp for s in bench.seen])
    assert climbs.max() <= 0.1041


def test_it_climbs_and_sinks_at_px4s_speeds_and_touches_down_softly():
    bench = Bench()
    bench.prepare()
    bench.do("takeoff", 6.0)
    bench.do("arm")
    bench.fly(4.0)
    assert bench.plant.velocity[2] == pytest.approx(1.5, abs=0.2)
    bench.fly(6.0)
    bench.do("land")
    bench.fly(3.0)
    assert bench.plant.velocity[2] == pytest.approx(-0.7, abs=0.2)
    while not bench.plant.on_ground:
        speed = bench.plant.velocity[2]
        bench.fly(0.004)
    assert -1.0 < speed < -0.3


def test_its_position_is_never_exact_but_close():
    bench = Bench().airborne()
    offsets = []
    for _ in range(40):
        bench.fly(0.25)
        offsets.append(bench.plant.position - [0.0, 0.0, HEIGHT])
    spread = np.std(offsets, axis=0)
    assert np.all((spread > 0.005) & (spread < 0.1))


def test_hold_brakes_and_stays():
    bench = Bench()
    bench.autopilot.px4.set_global_origin()
    bench.airborne()
    assert bench.mode is FlightMode.HOLD
    bench.fly(0.1, send=(0.0, 0.0, 0.0, GRAVITY))
    bench.do("start_offboard")
    bench.plant._state[at.VELOCITY : at.VELOCITY + 2] = (4.0, -3.0)
    bench.do("hold")
    start = bench.plant.position
    bench.fly(6.0)
    assert np.linalg.norm(bench.plant.velocity) < 0.3
    way = (bench.plant.position - start)[:2]
    assert np.linalg.norm(way) == pytest.approx(25.0 / (2.0 * 3.0), rel=0.25)
    assert bench.plant.position[2] == pytest.approx(HEIGHT, abs=0.4)


def test_hold_is_refused_in_flight_without_a_global_position():
    bench = Bench().airborne()
    with pytest.raises(AutopilotError, match=r"hold refused: .*global position"):
        bench.autopilot.hold().send(None)
    assert bench.mode is FlightMode.TAKEOFF


def test_it_holds_in_wind():
    bench = Bench(wind=5.0, gust=1.0).airborne()
    bench.fly(6.0)
    assert np.linalg.norm(bench.plant.position[:2]) < 0.7
    assert bench.mode is FlightMode.TAKEOFF


def test_arming_is_refused_before_there_is_a_position():
    bench = Bench()
    bench.fly(0.5)
    assert not bench.autopilot.status.latest.ready
    bench.do("takeoff", 1.0)
    with pytest.raises(AutopilotError, match=r"arming refused: .*local position"):
        bench.autopilot.arm().send(None)
    bench.fly(0.7)
    assert bench.autopilot.status.latest.ready
    bench.do("arm")
    assert bench.armed


def test_its_texts_are_told_once_the_application_has_connected():
    bench = Bench()
    told = []
    bench.autopilot.notices.tap(lambda event: told.append((event.kind, event.text)))
    bench.do("connect")
    bench.airborne()
    assert ("autopilot", "Takeoff detected") in told
    assert not bench.autopilot.px4.texts


def test_poses_reach_the_estimator_no_more_often_than_it_takes_them(monkeypatch):
    bench = Bench()
    taken = []
    monkeypatch.setattr(bench.autopilot.px4, "external_vision", lambda stamp, *_: taken.append(stamp))
    bench.fly(1.0, piece=0.005)
    assert np.diff(taken) == pytest.approx(0.02)


def test_disarming_in_flight_is_refused_but_killing_is_not():
    bench = Bench().airborne()
    with pytest.raises(AutopilotError, match="not landed"):
        bench.autopilot.disarm().send(None)
    bench.do("kill")
    assert not bench.armed
    bench.do("disarm")


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan])
def test_a_takeoff_without_height_is_refused(height):
    bench = Bench()
    bench.prepare()
    with pytest.raises(AutopilotError, match="height must be positive"):
        bench.autopilot.takeoff(height).send(None)


def test_offboard_is_refused_without_a_fresh_setpoint():
    bench = Bench().airborne()
    with pytest.raises(AutopilotError, match="No offboard signal"):
        bench.autopilot.start_offboard().send(None)
    bench.fly(0.1, send=(0.0, 0.0, 0.0, GRAVITY))
    assert bench.mode is FlightMode.TAKEOFF
    bench.fly(0.62)
    with pytest.raises(AutopilotError, match="No offboard signal"):
        bench.autopilot.start_offboard().send(None)


def test_arming_in_land_is_refused():
    bench = Bench()
    bench.prepare()
    bench.do("land")
    with pytest.raises(AutopilotError, match="Mode not suitable for arming"):
        bench.autopilot.arm().send(None)


def test_offboard_follows_rates_and_thrust():
    bench = Bench().airborne()
    bench.fly(0.05, send=(0.0, 0.0, 0.0, GRAVITY))
    bench.do("start_offboard")
    bench.fly(0.4, send=(0.5, -0.4, 0.3, 1.2 * GRAVITY))
    assert bench.mode is FlightMode.OFFBOARD
    assert bench.plant.angular_velocity == pytest.approx([0.5, -0.4, 0.3], abs=0.06)
    assert bench.plant.specific_force[2] == pytest.approx(1.2 * GRAVITY, rel=0.06)


def test_a_command_takes_effect_after_the_delay():
    vehicle = load_vehicle("limits")
    bench = Bench("limits").airborne()
    bench.fly(0.2, send=(0.0, 0.0, 0.0, GRAVITY))
    bench.do("start_offboard")
    bench.fly(0.2, send=(0.0, 0.0, 0.0, GRAVITY))
    quiet = abs(bench.plant.angular_velocity[0])
    sent = bench.now
    bench.fly(0.06, send=(4.0, 0.0, 0.0, GRAVITY))
    times = np.arange(sent, bench.now, 0.001)
    rolls = np.array([bench.plant.state_at(t)[11] for t in times])
    began = times[np.argmax(np.abs(rolls) > quiet + 0.01)] - sent
    assert vehicle.delay <= began < vehicle.delay + 0.008


def test_losing_the_application_lands():
    bench = Bench().airborne()
    bench.fly(0.05, send=(0.0, 0.0, 0.0, GRAVITY))
    bench.do("start_offboard")
    bench.fly(0.3, send=(0.0, 0.0, 0.0, GRAVITY))
    lost = bench.now
    bench.fly(0.48)
    assert bench.mode is FlightMode.OFFBOARD
    bench.fly(0.13)
    assert bench.mode is FlightMode.LAND
    change = next(s.stamp for s in bench.seen if s.mode is FlightMode.LAND)
    assert 0.49 < change - lost < 0.61
    bench.fly(8.0)
    assert not bench.armed
    assert bench.plant.on_ground
    assert quat_from_euler(0.0, 0.0, 0.0) @ bench.plant.orientation == pytest.approx(1.0, abs=1e-3)


def test_one_long_advance_does_what_many_short_ones_do():
    flights = []
    for piece in (0.004, 3.7):
        bench = Bench().airborne()
        bench.fly(0.05, send=(0.0, 0.0, 0.0, GRAVITY))
        bench.do("start_offboard")
        bench.fly(3.7, piece=piece, see=False)
        flights.append(bench.plant.state_at(bench.now))
    assert flights[0] == pytest.approx(flights[1], abs=1e-12)


def test_the_trace_holds_the_whole_of_an_advance():
    bench = Bench().airborne()
    before = bench.plant.time
    bench.now += 0.1
    bench.autopilot.advance(bench.now)
    assert bench.plant.trace[0, 0] == pytest.approx(before + 0.001)
    assert len(bench.plant.trace) == 100


def test_armed_on_the_ground_it_disarms_by_itself():
    bench = Bench()
    bench.prepare()
    bench.fly(0.1, send=(0.0, 0.0, 0.0, 0.0))
    bench.do("start_offboard")
    bench.do("arm")
    bench.fly(9.5, send=(0.0, 0.0, 0.0, 0.0))
    assert bench.armed
    bench.fly(0.8, send=(0.0, 0.0, 0.0, 0.0))
    assert not bench.armed


def test_takeoff_before_arming_waits_for_it():
    bench = Bench()
    bench.prepare()
    bench.do("takeoff", 1.0)
    bench.fly(1.0)
    assert bench.plant.on_ground
    bench.do("arm")
    bench.fly(6.0)
    assert bench.mode is FlightMode.TAKEOFF
    assert bench.plant.position[2] == pytest.approx(1.0, abs=0.25)


def test_it_flies_again_after_landing():
    bench = Bench().airborne()
    bench.do("land")
    bench.fly(6.0)
    bench.do("takeoff", 2.0)
    bench.do("arm")
    bench.fly(6.0)
    assert bench.plant.position[2] == pytest.approx(2.0, abs=0.25)


def test_a_crash_stops_the_motors_for_good():
    bench = Bench().airborne()
    bench.autopilot.crash()
    assert not bench.armed
    bench.fly(2.0)
    assert bench.plant.on_ground
    assert np.all(bench.plant.rotor_speeds == 0.0)
    with pytest.raises(AutopilotError, match="motor failure"):
        bench.autopilot.arm().send(None)
