import math

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as dialect

from sim.mavlink.codec import Decoder, checksum, encode, kind, named, pack

single = st.floats(width=32, allow_nan=False)


def test_the_checksum_is_that_of_the_specification():
    # The check value of CRC-16/MCRF4XX.
    assert checksum(b"123456789") == 0x6F91


@given(st.lists(single, min_size=7, max_size=7), st.integers(0, 65535), st.integers(0, 255))
def test_pymavlink_reads_what_is_packed(values, command, sequence):
    message = named("COMMAND_LONG")
    payload = encode(message, **{f"param{i + 1}": v for i, v in enumerate(values)}, command=command, target_system=3)
    parser = dialect.MAVLink(None)
    (read,) = parser.parse_buffer(pack(message, payload, sequence, 7, 8))
    assert [getattr(read, f"param{i + 1}") for i in range(7)] == values
    assert (read.command, read.target_system, read.target_component) == (command, 3, 0)
    assert (read.get_srcSystem(), read.get_srcComponent(), read.get_seq()) == (7, 8, sequence)


@given(st.lists(single, min_size=4, max_size=4), single, st.booleans())
def test_what_pymavlink_packs_is_read(q, thrust, old):
    sender = dialect.MAVLink(None, 255, 190)
    message = dialect.MAVLink_set_attitude_target_message(5, 1, 1, 128, q, 0.25, -0.5, 0.0, thrust)
    data = message.pack(sender, force_mavlink1=old)
    (frame,) = Decoder().frames(data + data[:0])
    fields = frame.decode()
    assert fields["q"] == tuple(q)
    assert (fields["thrust"], fields["body_pitch_rate"], fields["type_mask"]) == (thrust, -0.5, 128)
    assert (frame.system, frame.component) == (255, 190)


def test_texts_and_arrays_survive():
    message = named("PARAM_VALUE")
    payload = encode(message, param_id=b"MPC_THR_HOVER", param_value=0.5, param_count=3)
    (frame,) = Decoder().frames(pack(message, payload, 0, 1, 1))
    assert frame.decode()["param_id"].rstrip(b"\0") == b"MPC_THR_HOVER"
    covariances = encode(named("ODOMETRY"), pose_covariance=(1.0, math.inf), quality=-1)
    (frame,) = Decoder().frames(pack(named("ODOMETRY"), covariances, 0, 1, 1))
    assert frame.decode()["pose_covariance"] == (1.0, math.inf, *[0.0] * 19)
    assert frame.decode()["quality"] == -1


def test_several_frames_in_one_datagram():
    ping = named("PING")
    data = b"".join(pack(ping, encode(ping, seq=n), n, 1, 1) for n in range(3))
    assert [frame.decode()["seq"] for frame in Decoder().frames(data)] == [0, 1, 2]


def test_what_is_damaged_is_counted_and_left_out():
    ping, decoder = named("PING"), Decoder()
    good = pack(ping, encode(ping, seq=9), 0, 1, 1)
    bad = bytearray(good)
    bad[12] ^= 1
    assert [frame.decode()["seq"] for frame in decoder.frames(bytes(bad) + good)] == [9]
    assert decoder.corrupt == 1
    assert list(decoder.frames(good[:-1])) == []
    assert list(decoder.frames(b"hello")) == []
    assert decoder.corrupt == 3


@given(st.binary(max_size=300))
def test_noise_is_never_a_message_and_never_an_error(noise):
    for frame in Decoder().frames(noise):
        assert frame.kind is not None


def test_an_unknown_message_is_passed_over():
    ping, decoder = named("PING"), Decoder()
    good = pack(ping, encode(ping, seq=1), 0, 1, 1)
    unknown = ping._replace(id=65000)
    assert kind(65000) is None
    data = pack(unknown, encode(ping, seq=2), 0, 1, 1) + good
    assert [frame.decode()["seq"] for frame in decoder.frames(data)] == [1]


def test_protocol_version_has_its_own_layout():
    assert named("PROTOCOL_VERSION").extra == 217
    assert named("PROTOCOL_VERSION").layout.size == 22
