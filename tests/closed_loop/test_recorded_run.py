"""One flight in simulation: what its log says is what can be worked out from it by hand."""

import dataclasses
import math
from pathlib import Path

import pytest

from flightapp import app, results
from flightapp.config import Config
from flightapp.inputs import BadInputError
from flightapp.interchange.compare import Options, compare
from flightapp.interchange.export import Format, export
from flightapp.interchange.sources import read_path
from flightapp.recording.reader import read_flight
from flightapp.time_lost import loss_table, time_lost

MISSION = Path(__file__).parents[2] / "missions" / "one_gate.py"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "one"
    flown = app.fly(app.FlightPlan(MISSION, out, overrides=("sim.camera=corners",), seed=11))
    return out, results.finish(flown, page=False)


def test_time_lost_is_told_leg_by_leg(run):
    """One gate: a leg to it and one to the finish, against a line that knows the gate from the start."""
    out, summary = run
    flight = read_flight(out / "flight.mcap")
    found = time_lost(flight, summary, "race")
    assert [loss.to for loss in found] == ["1", "finish"]
    assert found[0].flown == pytest.approx(summary["gates"][0]["time"], abs=1e-6)
    assert sum(loss.flown for loss in found) == pytest.approx(summary["elapsed"], abs=1e-5)
    for loss in found:
        assert 0.5 < loss.least < loss.flown + 0.3
    assert sum(loss.lost for loss in found) > 0.0
    assert len(loss_table(found, "race").rows) == 3
    blind = dataclasses.replace(flight, header={**flight.header, "track": ""})
    with pytest.raises(BadInputError, match="no gates whose places are known"):
        time_lost(blind, summary, "race")


def test_a_run_is_exported_and_compared_with_itself(run, tmp_path):
    """Each format holds the estimate as the log does: the errors against the truth are the same from all of them."""
    out, _ = run
    expected = compare(read_path(f"{out}:truth"), read_path(f"{out}:state"), Options())["ape"]["se3"]
    for form in (Format.CSV, Format.TUM):
        written = export(out, form, tmp_path / form)
        paths = [read_path(f"{written / name}.{form}") for name in ("truth", "state")]
        found = compare(*paths, Options())["ape"]["se3"]
        for part in ("translation", "rotation"):
            assert found[part] == pytest.approx(expected[part], rel=1e-6, abs=1e-9), form


def racing(flight):
    """First and last stamp of the race, from the phases alone."""
    phases = [event for event in flight.events if event.kind == "phase"]
    first = next(i for i, event in enumerate(phases) if event.text.startswith("flying"))
    last = next(event for event in phases[first:] if not event.text.startswith("flying"))
    return phases[first].stamp, last.stamp


def rmse_by_hand(reference, other, start, end):
    """Per axis and in all, in plain loops: ``other`` is read on straight lines between its rows."""
    sums, count, k = [0.0, 0.0, 0.0], 0, 0
    stamps = [float(stamp) for stamp in other.stamp]
    for stamp, position in zip(reference.stamp.tolist(), reference.position.tolist(), strict=True):
        if not (start <= stamp <= end and stamps[0] <= stamp <= stamps[-1]):
            continue
        while k + 2 < len(stamps) and stamps[k + 1] < stamp:
            k += 1
        part = (stamp - stamps[k]) / (stamps[k + 1] - stamps[k])
        for axis in range(3):
            before, after = float(other.position[k, axis]), float(other.position[k + 1, axis])
            sums[axis] += (position[axis] - (before + part * (after - before))) ** 2
        count += 1
    assert count > 500
    axes = [math.sqrt(total / count) for total in sums]
    return {**dict(zip("xyz", axes, strict=True)), "total": math.sqrt(sum(sums) / count)}


def test_rmse_recomputed_by_hand(run):
    out, summary = run
    flight = read_flight(out / "flight.mcap")
    start, end = racing(flight)
    pairs = {
        "tracking_rmse": (flight.setpoints, flight.states),
        "tracking_rmse_truth": (flight.setpoints, flight.truth),
        "estimation_rmse": (flight.states, flight.truth),
    }
    for name, (reference, other) in pairs.items():
        assert summary[name] == pytest.approx(rmse_by_hand(reference, other, start, end), abs=1e-6), name
        assert summary[name]["total"] > 1e-3
    assert summary["elapsed"] == pytest.approx(end - start, abs=1e-6)


def test_latencies_of_virtual_time_are_those_of_sensors_and_preset(run):
    """Detection and plans take what the configuration says, commands nothing; the rest is waiting for ticks."""
    _, summary = run
    config, latency = Config(), summary["latency"]
    assert latency["camera"]["p50"] == pytest.approx(config.camera.latency, abs=1e-6)
    assert latency["detection"]["p99"] == pytest.approx(config.compute.detection, abs=1e-6)
    assert latency["plan"]["p50"] == pytest.approx(config.compute.plan, abs=1e-6)
    assert latency["command"]["p99"] == 0.0
    chain = sum(latency[stage]["p50"] for stage in ("camera", "detection", "estimate"))
    assert chain <= latency["camera to command"]["p50"] <= chain + 2.0 / config.control.rate
    assert 0.0 < latency["pose to command"]["p50"] < 0.03
    saturated = summary["saturation"]
    assert all(0.0 <= share < 0.2 for share in saturated.values())
    assert summary["effort"]["thrust_mean"] == pytest.approx(10.0, abs=1.0)
