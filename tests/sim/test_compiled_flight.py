"""Vehicle and control alone, without leaving compiled code."""

from flightapp.config import load_config
from sim.bench import course, laps


def test_the_compiled_flight_really_follows_its_line():
    line = course(1)
    assert 6.0 < line.duration < 12.0
    assert 1e-3 < laps(load_config(), line) < 0.5


def test_bench_vehicle_and_control(benchmark):
    config, line = load_config(), course(1)
    assert benchmark(laps, config, line) < 0.5
