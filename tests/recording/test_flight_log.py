"""The flight log: what is written is read back, whole or cut off."""

import dataclasses
import hashlib
import math
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import recorded_messages as sample
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from flightapp.inputs import BadInputError
from flightapp.messages import Frame
from flightapp.recording.reader import read_flight
from flightapp.recording.records import RECORDS, decode, encode, json_schema
from flightapp.recording.wire import FIXED
from flightapp.recording.writer import FLUSH_INTERVAL, FlightLog

HEADER = {"mission": "five_gates", "seed": "3"}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    sample.write_stream(log, 3.0)
    log.close()
    return path.read_bytes()


@pytest.fixture(scope="module")
def full(whole, tmp_path_factory):
    path = tmp_path_factory.mktemp("full") / "flight.mcap"
    path.write_bytes(whole)
    return read_flight(path)


def same(a, b):
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and (a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b)))


def test_fast_messages_come_back_exactly(tmp_path, rng):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    sent = {name: [make(rng, 0.005 * i) for i in range(40)] for name, make in sample.FAST.items()}
    for name, messages in sent.items():
        for message in messages:
            log.write(name, message)
    log.close()
    flight = read_flight(path)
    assert flight.header == HEADER
    assert flight.complete
    streams = {"pose": flight.poses, "state": flight.states, "truth": flight.truth}
    streams |= {"setpoint": flight.setpoints, "command": flight.commands, "stage": flight.stages}
    for name, columns in streams.items():
        for i, message in enumerate(sent[name]):
            for field in dataclasses.fields(message):
                if field.name not in ("covariance", "doubt"):
                    assert np.array_equal(getattr(columns, field.name)[i], getattr(message, field.name))
    assert np.array_equal(flight.states.variance[5], np.diag(sent["state"][5].covariance))
    assert set(flight.states.doubtful) == {1}


def test_an_acceleration_that_was_not_told_is_nan(tmp_path, rng):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    log.write("pose", dataclasses.replace(sample.pose(rng, 0.0), acceleration=None))
    log.close()
    assert np.isnan(read_flight(path).poses.acceleration).all()


def test_of_states_with_one_stamp_the_last_counts(tmp_path, rng):
    """A late pose corrects what the inertial sensors alone had told of the same moment."""
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    sent = [sample.state(rng, stamp) for stamp in (0.0, 0.005, 0.01, 0.01, 0.015)]
    for message in sent:
        log.write("state", message)
    log.close()
    states = read_flight(path).states
    assert states.stamp.tolist() == [0.0, 0.005, 0.01, 0.015]
    assert np.array_equal(states.position, [sent[i].position for i in (0, 1, 3, 4)])


@pytest.mark.parametrize("name", sample.FAST)
def test_fast_messages_are_protobuf_that_others_can_read(name, rng):
    message = sample.FAST[name](rng, 1.25)
    fixed = FIXED[type(message)]
    files = descriptor_pb2.FileDescriptorSet.FromString(fixed.layout.schema)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(files.file[0])
    parsed = message_factory.GetMessageClass(pool.FindMessageTypeByName(fixed.layout.name))()
    parsed.ParseFromString(fixed.encode(message))
    for field in dataclasses.fields(message):
        key, expected = field.name, getattr(message, field.name)
        if key == "covariance":
            key, expected = "variance", np.diag(expected)
        if key == "doubt":
            key, expected = "doubtful", 1
        assert np.array_equal(np.array(getattr(parsed, key)), expected)


def test_irregular_messages_come_back_exactly(tmp_path, rng):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    sent = sample.irregular(rng, 2.0)
    gates = (sample.gate(rng, 0), sample.gate(rng, 1, 1.5))
    for name, message in sent.items():
        log.write(name, message)
    log.write("truth_gates", gates)
    log.close()
    flight = read_flight(path)
    read = {
        "gate_map": flight.maps,
        "sightings": flight.sightings,
        "trajectory": flight.trajectories,
        "status": flight.statuses,
        "event": flight.events,
        "plan": flight.plans,
        "passage": flight.passages,
        "collision": flight.collisions,
    }
    for name, message in sent.items():
        assert same(read[name], (message,)), name
    assert same(flight.true_gates, (gates,))


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=3, max_size=3), st.floats())
def test_numbers_that_are_not_finite_survive_as_json(position, last_seen):
    gate = sample.gate(np.random.default_rng(0), 0, last_seen)
    gate = dataclasses.replace(gate, position=np.array(position))
    encoded = encode(gate)
    assert b"NaN," not in encoded.replace(b'"NaN",', b"")
    assert same(decode(type(gate), encoded), gate)


def test_every_schema_names_the_fields_of_its_message():
    for name, record in RECORDS.items():
        for field in dataclasses.fields(record):
            assert f'"{field.name}"'.encode() in json_schema(record), name


def test_same_messages_same_bytes_in_another_process(tmp_path, whole):
    path = tmp_path / "again.mcap"
    code = f"""
        from pathlib import Path
        import recorded_messages as sample
        from flightapp.recording.writer import FlightLog
        log = FlightLog(Path({str(path)!r}), header={HEADER!r})
        sample.write_stream(log, 3.0)
        log.close()
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, env=_environment())
    assert hashlib.sha256(path.read_bytes()).hexdigest() == hashlib.sha256(whole).hexdigest()


@settings(max_examples=40, deadline=None)
@given(fraction=st.floats(0.0, 1.0, exclude_max=True))
def test_log_cut_off_anywhere_reads_to_where_it_is_whole(whole, full, tmp_path_factory, fraction):
    path = tmp_path_factory.mktemp("cut") / "flight.mcap"
    path.write_bytes(whole[: int(fraction * len(whole))])
    try:
        flight = read_flight(path)
    except BadInputError as error:
        assert fraction * len(whole) < 200
        assert "empty" in str(error) or "cut off" in str(error)
        return
    n = flight.states.stamp.size
    assert np.array_equal(flight.states.position, full.states.position[:n])
    assert same(flight.maps, full.maps[: len(flight.maps)])


def test_cut_off_log_has_all_chunks_before_the_cut(whole, tmp_path):
    """Half a second of log time per chunk: what lies before the cut is there, up to one chunk."""
    path = tmp_path / "flight.mcap"
    per_second = len(whole) / 3.0
    path.write_bytes(whole[: int(2.0 * per_second)])
    flight = read_flight(path)
    assert not flight.complete
    assert flight.header == HEADER
    assert flight.states.stamp[-1] > 2.0 - 2.0 * FLUSH_INTERVAL


def test_zeros_after_the_last_record_are_no_damage(tmp_path, rng):
    """A file system that lost power may leave the file longer than what was written."""
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header=HEADER)
    for i in range(120):
        log.write("state", sample.state(rng, 0.01 * i))
    path.write_bytes(path.read_bytes() + bytes(5000))
    flight = read_flight(path)
    assert not flight.complete
    assert flight.states.stamp[-1] == pytest.approx(1.0)
    log.close()


def test_killed_process_leaves_a_log_up_to_the_last_second(tmp_path):
    path = tmp_path / "flight.mcap"
    code = f"""
        import sys, time
        from pathlib import Path
        import numpy as np
        import recorded_messages as sample
        from flightapp.recording.writer import FlightLog
        rng = np.random.default_rng(0)
        log = FlightLog(Path({str(path)!r}), header={HEADER!r})
        for i in range(1000000):
            log.write("state", sample.state(rng, i / 200))
            sys.stdout.write(f"{{i / 200}}\\n")
            sys.stdout.flush()
    """
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True, env=_environment()
    )
    assert child.stdout is not None
    for _ in range(700):
        child.stdout.readline()
    os.kill(child.pid, signal.SIGKILL)
    rest = [line for line in child.stdout.read().splitlines(keepends=True) if line.endswith("\n")]
    child.wait()
    last = float(rest[-1]) if rest else 699 / 200
    flight = read_flight(path)
    assert not flight.complete
    assert last - flight.states.stamp[-1] <= 1.0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "empty"),
        (b"hello, world, this is text", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "cut off before"),
        (b"\x89MCAP0\r\n\x01\x0c\0\0\0\0\0\0\0\x04\0\0\0ros2\0\0\0\0", "not a flight log of flightapp"),
        (b"\x89MCAP0\r\n\x01\x13\0\0\0\0\0\0\0\x0b\0\0\0flightapp/9\0\0\0\0", "format version 9"),
    ],
)
def test_what_is_no_flight_log_is_refused_in_words(tmp_path, content, said):
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=said):
        read_flight(path)


def test_missing_log_is_refused_in_words(tmp_path):
    with pytest.raises(BadInputError, match="no such flight log"):
        read_flight(tmp_path / "none.mcap")


@settings(max_examples=40, deadline=None)
@given(where=st.one_of(st.integers(0, 1500), st.integers(0, 10**9)), flip=st.integers(1, 255))
def test_damage_is_found_or_harmless(whole, full, tmp_path_factory, where, flip):
    """A flipped byte is refused in words, ends the log like a cut, or lies where nothing is read."""
    path = tmp_path_factory.mktemp("damage") / "flight.mcap"
    damaged = bytearray(whole)
    damaged[where % len(whole)] ^= flip
    path.write_bytes(damaged)
    try:
        flight = read_flight(path)
    except BadInputError:
        return
    n = flight.states.stamp.size
    assert np.array_equal(flight.states.position, full.states.position[:n])
    if flight.complete:
        assert n == full.states.stamp.size
        assert flight.header == full.header


def test_header_entries_added_later_win(tmp_path):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={"outcome": "none yet", "seed": "1"})
    log.annotate({"outcome": "GOAL_ACHIEVED"})
    log.close()
    assert read_flight(path).header == {"outcome": "GOAL_ACHIEVED", "seed": "1"}


def test_messages_out_of_order_are_read_in_the_order_of_their_stamps(tmp_path, rng):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={})
    for stamp in (0.3, 0.1, 0.2):
        log.write("command", sample.command(rng, stamp))
        log.write("plan", sample.irregular(rng, stamp)["plan"])
    log.close()
    flight = read_flight(path)
    assert flight.commands.stamp.tolist() == [0.1, 0.2, 0.3]
    assert [plan.stamp for plan in flight.plans] == [0.1, 0.2, 0.3]


def test_view_channels_are_foxglove_schemas(tmp_path, rng):
    path = tmp_path / "flight.mcap"
    log = FlightLog(path, header={})
    sample.write_stream(log, 1.0)
    log.write("frame", Frame(0.5, 1, np.full((48, 64), 90, np.uint8)))
    log.write("frame", Frame(0.6, 2, None))
    log.close()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    counts = {c.topic: summary.statistics.channel_message_counts.get(i, 0) for i, c in summary.channels.items()}
    schemas = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
    assert 27 <= counts["/view/tf"] <= 31
    assert counts["/view/gates"] == 5
    assert counts["/view/trajectory"] == 10
    assert counts["/view/camera"] == 1
    assert counts["/view/log"] == 10
    assert schemas["/view/tf"] == "foxglove.FrameTransform"
    assert schemas["/view/gates"] == schemas["/view/trajectory"] == "foxglove.SceneUpdate"
    assert schemas["/view/camera"] == "foxglove.CompressedImage"


def test_messages_that_cannot_be_recorded_are_refused(tmp_path, rng):
    log = FlightLog(tmp_path / "flight.mcap", header={})
    with pytest.raises(TypeError, match="str cannot be recorded"):
        log.write("text", "hello")
    with pytest.raises(Exception, match="pack expected"):
        log.write("command", dataclasses.replace(sample.command(rng, 0.0), rates=np.zeros(2)))
    with pytest.raises(ValueError, match="NaN"):
        log.write("command", sample.command(rng, math.nan))
    log.close()


def test_an_existing_log_is_never_overwritten(tmp_path):
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        FlightLog(path, header={})
    assert path.read_bytes() == b"precious"


def test_full_disk_is_told_at_the_end_not_in_flight(rng, monkeypatch):
    real = Path.open
    monkeypatch.setattr(Path, "open", lambda self, mode="r", **options: real(self, "wb", **options))
    log = FlightLog(Path("/dev/full"), header=HEADER)
    for i in range(500):
        log.write("state", sample.state(rng, 0.005 * i))
    assert log.error is not None
    with pytest.raises(OSError, match="No space left"):
        log.close()


def _environment():
    return {**os.environ, "PYTHONPATH": str(Path(sample.__file__).parent)}
