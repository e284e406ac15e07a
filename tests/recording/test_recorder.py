"""The recorder's taps, its queue, and what one message costs."""

import numpy as np
import pytest
import recorded_messages as sample

from flightapp.channel import Topic
from flightapp.recording.reader import read_flight
from flightapp.recording.recorder import Recorder
from flightapp.recording.writer import FlightLog


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("threaded", [False, True])
def test_what_flows_through_topics_is_in_the_log(tmp_path, rng, threaded):
    path = tmp_path / "flight.mcap"
    recorder = Recorder(FlightLog(path, header={"seed": "1"}, durable=threaded), threaded=threaded)
    commands, states = Topic("command"), Topic("state")
    recorder.tap(commands)
    recorder.tap(states, every=5)
    for i in range(100):
        commands.publish(sample.command(rng, 0.004 * i))
        states.publish(sample.state(rng, 0.004 * i))
    recorder.close(outcome="GOAL_ACHIEVED")
    flight = read_flight(path)
    assert np.allclose(flight.commands.stamp, 0.004 * np.arange(100))
    assert np.allclose(flight.states.stamp, 0.02 * np.arange(20))
    assert flight.header == {"seed": "1", "outcome": "GOAL_ACHIEVED"}


def test_full_queue_drops_and_counts(tmp_path, rng, monkeypatch):
    path = tmp_path / "flight.mcap"
    monkeypatch.setattr("flightapp.recording.recorder.DRAIN_INTERVAL", 3600.0)
    recorder = Recorder(FlightLog(path, header={}), capacity=10, threaded=True)
    topic = Topic("command")
    recorder.tap(topic)
    for i in range(25):
        topic.publish(sample.command(rng, 0.004 * i))
    recorder.close()
    assert recorder.dropped == 15
    flight = read_flight(path)
    assert flight.commands.stamp.size == 10
    assert flight.header["dropped"] == "15"


@pytest.mark.parametrize("threaded", [False, True])
def test_a_message_that_cannot_be_encoded_is_counted_not_raised(tmp_path, rng, threaded):
    path = tmp_path / "flight.mcap"
    recorder = Recorder(FlightLog(path, header={}), threaded=threaded)
    topic = Topic("command")
    recorder.tap(topic)
    topic.publish(sample.command(rng, float("nan")))
    topic.publish(sample.command(rng, 0.5))
    recorder.close()
    assert recorder.refused == 1
    assert recorder.reason.startswith("command: ")
    flight = read_flight(path)
    assert flight.commands.stamp.tolist() == [0.5]
    assert flight.header["refused"] == "1"


@pytest.mark.parametrize("name", sample.FAST)
def test_recorder_write(benchmark, tmp_path, rng, name):
    recorder = Recorder(FlightLog(tmp_path / "flight.mcap", header={}), threaded=False)
    topic = Topic(name)
    recorder.tap(topic)
    messages = [sample.FAST[name](rng, 0.004 * i) for i in range(1000)]
    benchmark(lambda: [topic.publish(message) for message in messages])
    recorder.close()
    assert recorder.refused == 0
