"""Effort, saturation, latencies, laps and legs against numbers worked out by hand."""

import math

import numpy as np
import pytest
from synthetic_flight import flight as made_up

from flightapp.config import Config
from flightapp.evaluation.effort import Bounds, bounds_of, control_effort, saturation
from flightapp.evaluation.flight import Commands, Flight, Stages
from flightapp.evaluation.latency import STAGES, latencies
from flightapp.evaluation.metrics import Window
from flightapp.evaluation.splits import FINISH, laps, losses, splits
from flightapp.evaluation.summary import flight_settings, summarise
from flightapp.evaluation.tables import flight_tables
from flightapp.evaluation.told import Told
from flightapp.frames import GRAVITY
from flightapp.messages import Drift, GateMap, GateSighting, PlanReport, Sightings, Stage

ALL = Window(-1e9, 1e9)


def commands(stamps, rates, thrust):
    return Commands(np.array(stamps, float), np.array(rates, float), np.array(thrust, float))


def test_effort_by_hand():
    """One second at 1 rad/s and 10 m/s², then three at 2 rad/s and 6 m/s²; the last command is held for no time."""
    found = control_effort(commands([0, 1, 4], [[1, 0, 0], [0, 2, 0], [9, 9, 9]], [10, 6, 99]), Window(-1.0, 4.0))
    assert found.rates == pytest.approx(1.0 + 3.0 * 4.0)
    assert found.thrust_mean == pytest.approx(7.0)
    assert found.thrust_variance == pytest.approx((9.0 + 3.0 * 1.0) / 4.0)
    assert found.rates_variation == pytest.approx((1 + 2 + 9 + 7 + 9) / 4.0)
    assert found.thrust_variation == pytest.approx((4 + 93) / 4.0)
    assert control_effort(commands([0], [[1, 0, 0]], [10]), ALL) is None


def test_saturation_counts_each_limit_by_itself():
    rates = [[6, 0, 0], [6 / math.sqrt(2), -6 / math.sqrt(2), 0], [5, 5, -3], [0, 0, 0], [1, 1, 1]]
    found = saturation(commands(range(5), rates, [30, 1, 9.8, 1.5, 29.9]), ALL, Bounds(6.0, 3.0, 1.0, 30.0))
    assert (found.rates, found.yaw_rate, found.thrust_max, found.thrust_min) == pytest.approx((0.4, 0.2, 0.2, 0.2))


def test_bounds_are_those_of_the_flights_own_config():
    config = Config()
    bounds = bounds_of(Told.model_validate(config.model_dump()))
    assert bounds.thrust_max == pytest.approx(config.vehicle.thrust_max)
    assert (bounds.rate, bounds.thrust_min) == (config.vehicle.rate_max, config.guard.thrust_min)
    assert bounds_of(Told()) is None
    assert bounds.thrust_max > GRAVITY


def sightings(stamp, *gates):
    seen = [GateSighting(stamp, i, np.zeros(3), np.zeros(4), np.eye(6), None, 4, 0.1) for i in gates]
    return Sightings(stamp, 0, (), tuple(seen))


def staged():
    """Frames at 1.0 to 1.3 s; the second saw no gate, the third was not heeded, after the last nothing is sent.

    Each waits 20 ms for detection, which takes 5 ms; the map follows 2 ms later. Ticks every 10 ms steer by poses that
    are 8 ms old and take 1 ms.
    """
    frames = 1.0 + 0.1 * np.arange(4)
    ticks = 1.005 + 0.01 * np.arange(30)
    n, m = len(frames), len(ticks)
    stamp = np.concatenate((frames + 0.025, ticks + 0.001))
    order = np.argsort(stamp)
    stages = Stages(
        stamp[order],
        np.repeat((Stage.DETECTION, Stage.COMMAND), (n, m)).astype(np.uint32)[order],
        np.concatenate((frames, ticks - 0.008))[order],
        np.concatenate((frames + 0.02, ticks))[order],
    )
    seen = (sightings(frames[0], 1), sightings(frames[1]), sightings(frames[2], 1, 2), sightings(frames[3], 2))
    drift = Drift(0.0, np.zeros(3), 0.0, np.eye(4))
    maps = tuple(GateMap(stamp + 0.027, 0, (), drift) for stamp in frames[[0, 1, 3]])
    plans = (PlanReport(1.0, 0.004, True, ""), PlanReport(1.1, 0.5, False, "late"))
    return Flight(sightings=seen, maps=maps, stages=stages, plans=plans)


def test_latencies_by_hand():
    found = latencies(staged(), Window(0.0, 2.0))
    assert tuple(found) == STAGES
    expected = {"camera": 20, "detection": 5, "estimate": 2, "plan": 4, "state": 8, "command": 1, "pose to command": 9}
    for stage, ms in expected.items():
        assert 1e3 * found[stage].p50 == pytest.approx(ms), stage
        assert 1e3 * found[stage].p99 == pytest.approx(ms), stage
    assert found["camera"].count == 4
    # The map that heeds the first frame is there at 1.027; the next tick is at 1.035, its command out a millisecond on.
    assert found["camera to command"].count == 1
    assert 1e3 * found["camera to command"].p50 == pytest.approx(36.0)


def test_a_log_without_stages_has_no_latencies_but_those_of_plans():
    assert tuple(latencies(made_up(), ALL)) == ("plan",)
    assert latencies(Flight(), ALL) == {}


def row(gate, lap, time):
    return {"id": gate, "lap": lap, "passed": time is not None, "time": time, "offset": None}


RACE = [row(1, 1, 2.0), row(2, 1, 5.0), row(1, 2, None), row(2, 2, 9.5)]


def test_splits_and_laps_by_hand():
    found = splits(RACE, 11.0)
    assert [(leg.lap, leg.to, leg.time) for leg in found] == [
        *((1, "1", 2.0), (1, "2", 3.0), (2, "1", None)),
        *((2, "2", None), (2, FINISH, 1.5)),
    ]
    assert [(lap.lap, lap.time) for lap in laps(RACE)] == [(1, 5.0), (2, 4.5)]
    assert splits([], 3.0) == ()
    assert laps([]) == ()


def test_losses_are_leg_by_leg():
    found = losses(splits(RACE, 11.0), (1.5, 4.0, 5.0, 7.0), 8.0)
    assert [loss.least for loss in found] == [1.5, 2.5, 1.0, 2.0, 1.0]
    assert [loss.lost for loss in found] == [0.5, 0.5, None, None, 0.5]
    with pytest.raises(ValueError, match="a line with 2 gates, and a flight with 4"):
        losses(splits(RACE, 11.0), (1.5, 4.0), 8.0)


def test_the_summary_tells_and_the_tables_show_it():
    flight = made_up()
    summary = summarise(flight)
    assert flight_settings(flight).race.v_max == 4.0
    assert summary["saturation"] is None  # the made-up config has no vehicle
    assert summary["effort"]["thrust_mean"] == pytest.approx(9.81, abs=0.05)
    assert [split["to"] for split in summary["splits"]] == ["0", "1", "2", "3", FINISH]
    ape = summary["estimation_ape"]
    assert ape["none"]["translation"]["rmse"] == pytest.approx(summary["estimation_rmse"]["total"], abs=2e-6)
    assert ape["se3"]["translation"]["rmse"] <= ape["yaw"]["translation"]["rmse"] <= ape["none"]["translation"]["rmse"]
    assert summary["estimation_rpe"]["translation"]["count"] == 10
    titles = [table.title for table in flight_tables(summary)]
    assert {"Pose errors, estimate − truth", "Commands", "Latency"} <= set(titles)
