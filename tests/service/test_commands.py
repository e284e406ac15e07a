"""The commands that talk to the service, and what they say."""

import json

import pytest
import typer
from typer.testing import CliRunner

from flightapp.commands import service, tune
from flightapp.inputs import BadInputError
from flightapp.service.client import VARIABLE
from flightapp.service.protocol import Abort, Reload, Start, Status, Stop, Tunables, Tune
from flightapp.service.server import ControlServer

ENDED = {"mission": "m", "run": "/runs/m-0-1", "outcome": "INTERRUPTED", "reason": "stop", "failed": ""}
FLIGHT = {
    "mission": "m",
    "run": "/runs/m-0-1",
    "phase": "flying",
    "behaviors": ["race"],
    "time": 3.2,
    "gates": [1, 5],
    "position": [1.0, 2.0, 1.5],
    "speed": 3.0,
    "battery": None,
    "faults": [],
}


class Played:
    """A service whose answers are played; the last one again and again."""

    def __init__(self):
        self.asked = []
        self.answers = {}

    def answer(self, request, _):
        self.asked.append(request)
        answers = self.answers[type(request)]
        return answers.pop(0) if len(answers) > 1 else answers[0]


@pytest.fixture
def played(tmp_path, monkeypatch):
    path = tmp_path / "control.sock"
    monkeypatch.setenv(VARIABLE, str(path))
    monkeypatch.setattr(service, "LOOK", 0.01)
    answers = Played()
    served = ControlServer(path, answers.answer)
    yield answers
    served.close()


def told(state="flying", flight=None, last=None):
    return {"ok": True, "state": state, "flight": flight, "last": last, "stopping": ""}


def test_a_start_returns_when_it_takes_off(played, tmp_path, monkeypatch, capsys):
    played.answers = {
        Start: [{"ok": True, "run": FLIGHT["run"]}],
        Status: [
            told("preparing", {"run": FLIGHT["run"]}),
            told(flight=FLIGHT | {"phase": "idle"}),
            told(flight=FLIGHT),
        ],
    }
    monkeypatch.chdir(tmp_path)
    service.start(service.Path("m.py"), service.Path("v.toml"), ["race.v_max=2"], 3, False)
    assert played.asked[0] == Start(
        mission=str(tmp_path / "m.py"), vehicle=str(tmp_path / "v.toml"), settings=("race.v_max=2",), seed=3
    )
    assert played.asked[1:] == [Status()] * 3
    assert "m is flying; its record: /runs/m-0-1" in capsys.readouterr().out


@pytest.mark.parametrize(("failed", "status"), [("", 0), ("INTERRUPTED", 1)])
def test_a_start_that_waits_ends_as_the_flight_does(played, tmp_path, failed, status, capsys):
    ended = ENDED | {"failed": failed}
    played.answers = {
        Start: [{"ok": True, "run": FLIGHT["run"]}],
        Status: [told(flight=FLIGHT), told("idle", last=ended)],
    }
    with pytest.raises(typer.Exit) as exit_:
        service.start(tmp_path / "m.py", None, None, 0, True)
    assert exit_.value.exit_code == status
    assert "INTERRUPTED: stop" in capsys.readouterr().out


def test_a_flight_that_the_service_has_forgotten_is_told(played, tmp_path):
    played.answers = {Start: [{"ok": True, "run": FLIGHT["run"]}], Status: [told("idle")]}
    with pytest.raises(BadInputError, match="knows nothing of"):
        service.start(tmp_path / "m.py", None, None, 0, True)


def test_what_is_refused_is_told_with_exit_status_1(played, capsys):
    played.answers = {Stop: [{"ok": False, "error": "nothing [flies]"}]}
    with pytest.raises(typer.Exit) as exit_:
        service.stop()
    assert exit_.value.exit_code == 1
    assert capsys.readouterr().err == "flightapp: refused: nothing [flies]\n"


def test_the_status_is_told_in_words_and_for_programs(played, capsys):
    played.answers = {Status: [told(flight=FLIGHT, last=ENDED)], Abort: [{"ok": True, "text": "it lands"}]}
    service.status(False)
    words = capsys.readouterr().out
    for one in ("service: flying", "1 of 5 passed", "3.2 s", "faults     none", "m, INTERRUPTED: stop"):
        assert one in words
    service.status(True)
    assert json.loads(capsys.readouterr().out) == {
        k: v for k, v in told(flight=FLIGHT, last=ENDED).items() if k != "ok"
    }
    service.abort()
    assert capsys.readouterr().out == "it lands\n"


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        (("a.b", ["2"]), {"a.b": "2"}),
        (("a.b=2", None), {"a.b": "2"}),
        (("a.b=2", ["c.d=[1, 2]"]), {"a.b": "2", "c.d": "[1, 2]"}),
    ],
)
def test_one_field_or_several_are_set(played, arguments, settings, capsys):
    played.answers = {Tune: [{"ok": True, "text": "retuned: a.b 1 → 2"}]}
    tune.set_live(*arguments)
    assert played.asked == [Tune(settings=settings)]
    assert capsys.readouterr().out == "retuned: a.b 1 → 2\n"


def test_a_negative_value_is_no_option(played):
    played.answers = {Tune: [{"ok": True, "text": "retuned"}]}
    done = CliRunner().invoke(tune.tune, ["set", "control.airborne_height", "-1"])
    assert done.exit_code == 0, done.output
    assert played.asked == [Tune(settings={"control.airborne_height": "-1"})]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("a.b", None), "'a.b': expected KEY VALUE"),
        (("a.b", ["1", "2"]), "expected KEY VALUE"),
        (("a.b=", None), "expected KEY VALUE"),
        (("a.b", [""]), "at least 1 character"),
        (("a.b=1", ["a.b=2"]), "given more than once: a.b"),
    ],
)
def test_what_cannot_be_set_is_told_before_the_service_is_asked(played, arguments, why):
    with pytest.raises(BadInputError, match=why):
        tune.set_live(*arguments)
    assert played.asked == []


def test_fields_are_listed_and_files_read_anew(played, capsys):
    field = {"key": "control.yaw_bandwidth", "value": 2.0, "start": 3.0, "bounds": "> 0.1", "description": "heading"}
    played.answers = {Tunables: [{"ok": True, "fields": [field]}], Reload: [{"ok": True, "text": "retuned: nothing"}]}
    tune.show()
    assert "heading" in capsys.readouterr().out
    tune.reload()
    assert capsys.readouterr().out == "retuned: nothing\n"


@pytest.mark.parametrize("options", [{}, {"sim": True, "connect": "udpin://127.0.0.1:1"}, {"mavlink": True}])
def test_a_service_must_know_what_to_fly(options):
    with pytest.raises(BadInputError, match="say what to fly"):
        service.serve(**options)


def test_a_place_for_missions_must_be_there(tmp_path):
    with pytest.raises(BadInputError, match="there is no such directory"):
        service.serve(sim=True, places=[tmp_path / "gone"])


def test_options_that_no_start_could_mend_are_told_at_once(tmp_path):
    with pytest.raises(BadInputError, match="no such vehicle file"):
        service.serve(sim=True, vehicle=tmp_path / "gone.toml", places=[tmp_path], socket=tmp_path / "control.sock")
    with pytest.raises(BadInputError, match="did you mean 'v_max'"):
        service.serve(sim=True, overrides=["race.vmax=3"], places=[tmp_path], socket=tmp_path / "control.sock")
