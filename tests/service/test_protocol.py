"""What a client may say."""

import json
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightapp.inputs import BadInputError
from flightapp.service.files import allowed_file
from flightapp.service.protocol import LINE, Abort, Reload, Request, Start, Status, Stop, Tunables, Tune, encode, parse

SOUND = [
    Start(mission="/m.py", vehicle="/v.toml", settings=("race.v_max=2",), seed=3),
    Start(mission="/m.py"),
    Stop(),
    Abort(),
    Status(),
    Tune(settings={"control.yaw_bandwidth": "2"}),
    Reload(),
    Tunables(),
]
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)
nearly = st.fixed_dictionaries(
    {"do": st.sampled_from(["start", "stop", "abort", "status", "tune", "reload", "tunables", "fly"])},
    optional={
        "mission": json_values,
        "vehicle": json_values,
        "settings": json_values,
        "seed": json_values,
        "x": json_values,
    },
)
messages = (
    st.binary(max_size=300)
    | nearly.map(lambda value: json.dumps(value).encode())
    | json_values.map(lambda value: json.dumps(value).encode())
)


@pytest.mark.parametrize("request_", SOUND)
def test_a_request_survives_the_way(request_):
    line = encode(request_)
    assert line.endswith(b"\n") and line.count(b"\n") == 1
    assert parse(line) == request_


@settings(max_examples=200)
@given(messages)
def test_whatever_comes_is_a_request_or_refused_in_words(line):
    try:
        assert isinstance(parse(line), Request)
    except BadInputError as error:
        assert 0 < len(str(error)) < 1000


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (b"", "JSON"),
        (b"[" * 5000, "JSON"),
        (b"null", "not a request"),
        (b'{"do": "fly"}', "'start'"),
        (b'{"do": "stop", "now": true}', "stop.now: Extra inputs"),
        (b'{"do": "start"}', "start.mission: Field required"),
        (b'{"do": "start", "mission": 3}', "valid string"),
        (b'{"do": "start", "mission": "/m.py", "seed": "3"}', "valid integer"),
        (b'{"do": "start", "mission": "/m.py", "seed": -1}', "greater than or equal to 0"),
        (b'{"do": "start", "mission": "' + b"x" * 5000 + b'"}', "at most 4096"),
        (b'{"do": "tune", "settings": {}}', "at least 1"),
        (b'{"do": "tune", "settings": {"a": 3}}', "valid string"),
        (b" " * (LINE + 1), f"longer than {LINE} bytes"),
    ],
)
def test_what_is_wrong_is_told(line, told):
    with pytest.raises(BadInputError, match=told):
        parse(line)


def test_files_come_from_where_they_may(tmp_path):
    place = (tmp_path / "missions").resolve()
    place.mkdir()
    (place / "m.py").write_text("")
    (tmp_path / "other.py").write_text("")
    (place / "link.py").symlink_to(tmp_path / "other.py")
    (place / "round.py").symlink_to(place / "round.py")
    (place / "inner").symlink_to(place / "m.py")
    os.mkfifo(place / "pipe.py")
    assert allowed_file(str(place / "m.py"), [place], "mission") == place / "m.py"
    assert allowed_file(str(place / "inner"), [place], "mission") == place / "m.py"
    for name, why in {
        str(place / "gone.py"): "no such file",
        str(place / "link.py"): "alone",
        str(place / ".." / "other.py"): "alone",
        "/etc/passwd": "alone",
        "m.py": "absolute",
        str(place / "pipe.py"): "not a regular file",
        str(place): "not a regular file",
        str(place / "round.py"): None,
        str(place / ("x" * 3000)): None,
        str(place / "nul\0.py"): None,
        str(place / "\ud800.py"): None,
    }.items():
        with pytest.raises(BadInputError, match=why) as told:
            allowed_file(name, [place], "mission")
        assert str(told.value).startswith("mission '")
