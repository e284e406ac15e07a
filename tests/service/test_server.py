"""The control socket under clients of every kind."""

import asyncio
import concurrent.futures
import json
import os
import random
import socket
import stat
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from flightapp.inputs import BadInputError
from flightapp.service import client, peer, server
from flightapp.service.peer import Peer, refusal
from flightapp.service.protocol import LINE, Abort, Start, Status, Stop, encode
from flightapp.service.server import ControlServer

OTHER = 54321
"""A user id that nobody has."""


@contextmanager
def serving(tmp_path, answer=lambda _request, _peer: {"ok": True}, **keywords):
    path = tmp_path / "control.sock"
    served = ControlServer(path, answer, **keywords)
    try:
        yield served, path
    finally:
        served.close()
    assert not path.exists()


def told(path, data, patience=10.0):
    """What comes back for ``data``, all of it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(patience)
        connection.connect(str(path))
        try:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
        except (BrokenPipeError, ConnectionResetError):
            pass
        received = b""
        try:
            while chunk := connection.recv(65536):
                received += chunk
        except ConnectionResetError:
            pass
    return received


def descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def empty(served):
    """Whether all connections have been closed, in a moment."""
    until = time.monotonic() + 10.0
    while served.clients and time.monotonic() < until:
        time.sleep(0.01)
    return served.clients == 0


def test_a_request_is_answered_and_its_sender_known(tmp_path):
    asked = []

    def answer(request, who):
        asked.append((request, who))
        return {"ok": True, "text": "söme"}

    with serving(tmp_path, answer) as (_, path):
        assert client.ask(Stop(), path) == {"ok": True, "text": "söme"}
        mode = path.stat().st_mode
    assert asked == [(Stop(), Peer(os.getpid(), os.getuid(), os.getgid()))]
    assert stat.S_IMODE(mode) == 0o660


def test_an_answer_may_take_its_time_and_others_do_not_wait_for_it(tmp_path):
    made = concurrent.futures.Future()

    def answer(request, _):
        return made if isinstance(request, Abort) else {"ok": True, "text": "now"}

    with serving(tmp_path, answer) as (_, path), concurrent.futures.ThreadPoolExecutor() as pool:
        slow = pool.submit(client.ask, Abort(), path)
        assert client.ask(Stop(), path)["text"] == "now"
        assert not slow.done()
        made.set_result({"ok": True, "text": "at last"})
        assert slow.result(10.0)["text"] == "at last"


@pytest.mark.parametrize("error", [BadInputError("not like this"), RuntimeError("a bug")])
def test_what_fails_is_an_answer_too(tmp_path, error):
    def answer(request, _):
        if isinstance(request, Stop):
            raise error
        failed = concurrent.futures.Future()
        failed.set_exception(error)
        return failed

    with serving(tmp_path, answer) as (_, path):
        for request in (Stop(), Abort()):
            refused = client.ask(request, path)
            assert not refused["ok"] and str(error) in refused["error"]


def test_who_is_not_allowed_gets_a_reason_and_nothing_is_done(tmp_path):
    asked = []

    def answer(request, _):
        asked.append(request)
        return {"ok": True}

    with serving(tmp_path, answer, identify=lambda _: Peer(1, OTHER, OTHER)) as (served, path):
        for request in (Start(mission="/m.py"), Stop(), Status()):
            refused = client.ask(request, path)
            assert not refused["ok"] and f"uid {OTHER} may not command" in refused["error"]
        assert empty(served)
    assert asked == []


@pytest.mark.parametrize("member", [False, True])
def test_root_the_own_user_and_the_group_are_allowed(monkeypatch, member):
    monkeypatch.setattr(peer.grp, "getgrnam", lambda _: type("Group", (), {"gr_gid": 4242}))
    monkeypatch.setattr(peer.pwd, "getpwuid", lambda _: type("User", (), {"pw_name": "someone", "pw_gid": 7}))
    monkeypatch.setattr(peer.os, "getgrouplist", lambda *_: [7, 4242] if member else [7])
    assert refusal(Peer(1, 0, 0)) == "" and refusal(Peer(1, os.geteuid(), 7)) == ""
    assert (refusal(Peer(1, OTHER, 7)) == "") is member
    if not member:
        assert "sudo usermod -aG flightapp" in refusal(Peer(1, OTHER, 7))


def test_without_the_group_only_root_and_the_own_user_are(monkeypatch):
    def nobody(_):
        raise KeyError

    monkeypatch.setattr(peer.grp, "getgrnam", nobody)
    assert "there is no group 'flightapp'" in refusal(Peer(1, OTHER, OTHER))
    assert refusal(Peer(1, 0, 0)) == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user; others are tested with one made up")
def test_another_user_is_refused_by_the_file_and_by_the_service(tmp_path):
    asked = []
    script = textwrap.dedent("""
        import os, socket, sys
        os.setgroups([]); os.setgid(54321); os.setuid(54321)
        with socket.socket(socket.AF_UNIX) as one:
            try:
                one.connect(sys.argv[1])
                one.sendall(b'{"do": "stop"}\\n')
            except (PermissionError, BrokenPipeError) as error:
                print(type(error).__name__)
            else:
                print(one.recv(4096).decode())
    """)
    place = Path("/tmp") / f"flightapp-test-{os.getpid()}"
    place.mkdir(mode=0o755)
    try:
        with serving(place, lambda request, _: asked.append(request) or {"ok": True}) as (_, path):
            command = [sys.executable, "-S", "-c", script, str(path)]
            first = subprocess.run(command, capture_output=True, text=True, check=True)
            path.chmod(0o666)
            second = subprocess.run(command, capture_output=True, text=True, check=True)
    finally:
        place.rmdir()
    assert first.stdout.strip() == "PermissionError"
    assert "uid 54321 may not command" in second.stdout or second.stdout.strip() == "BrokenPipeError"
    assert asked == []


def test_who_says_nothing_is_sent_away_and_holds_nobody_up(tmp_path, monkeypatch):
    monkeypatch.setattr(server, "TIME", 0.5)
    with (
        serving(tmp_path) as (served, path),
        socket.socket(socket.AF_UNIX) as silent,
        socket.socket(socket.AF_UNIX) as slow,
    ):
        for one in (silent, slow):
            one.settimeout(10.0)
            one.connect(str(path))
        slow.sendall(b'{"do":')
        assert client.ask(Status(), path)["ok"]
        for one in (silent, slow):
            assert "no request within 0.5 s" in json.loads(one.recv(4096))["error"]
        assert empty(served)


def test_who_does_not_take_the_answer_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr(server, "TIME", 0.5)
    long = {"ok": True, "text": "x" * 3_000_000}
    with serving(tmp_path, lambda *_: long) as (served, path), socket.socket(socket.AF_UNIX) as deaf:
        deaf.connect(str(path))
        deaf.sendall(encode(Status()))
        assert deaf.recv(10)
        assert empty(served)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"x" * (LINE + 10), f"longer than {LINE}"),
        (b'{"do": "stop"}', "ended by a newline"),
        (b"\n", "not a request"),
        (b"\xff\xfe\n", "not a request"),
    ],
)
def test_what_is_no_request_is_refused(tmp_path, data, why):
    with serving(tmp_path) as (_, path):
        assert why in json.loads(told(path, data))["error"]


def fuzz(rng):
    """A message of one kind of nonsense or another."""
    kind = rng.randrange(5)
    if kind == 0:
        return rng.randbytes(rng.randrange(400))
    sound = bytearray(encode(rng.choice([Stop(), Status(), Start(mission="/m.py", settings=("a=1",))])))
    if kind == 1:
        for _ in range(rng.randrange(1, 6)):
            sound[rng.randrange(len(sound))] = rng.randrange(256)
        return bytes(sound)
    if kind == 2:
        return bytes(sound[: rng.randrange(len(sound))])
    if kind == 3:
        return json.dumps({"do": rng.choice(["start", "tune", 3, None]), "mission": rng.random()}).encode() + b"\n"
    return rng.choice([b"[", b'{"a":', b'"', b"1e999", b"\0"]) * rng.randrange(1, 4000) + b"\n"


def test_thousands_of_nonsense_messages_change_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(server, "REST", 0.0)
    asked, before = [], descriptors()

    def answer(request, _):
        asked.append(request)
        return {"ok": True}

    def crowd(path, seed):
        rng = random.Random(seed)
        for _ in range(1000):
            data = fuzz(rng)
            replies = told(path, data)
            assert replies == b"" or (replies.endswith(b"\n") and "ok" in json.loads(replies)), data

    with serving(tmp_path, answer) as (served, path), concurrent.futures.ThreadPoolExecutor(4) as pool:
        for done in [pool.submit(crowd, path, seed) for seed in range(10)]:
            done.result(120.0)
        assert client.ask(Status(), path)["ok"]
        assert empty(served)
    assert descriptors() == before
    # What was altered in a byte may still be sound; what was not a request has reached nobody.
    assert all(isinstance(one, Stop | Status | Start) for one in asked)


async def ticking(seconds, rate=250.0):
    """Ticks of a sender-like task on the wall clock, with the lateness of each, s."""
    loop, late = asyncio.get_running_loop(), []
    begun = loop.time()
    for k in range(1, int(seconds * rate)):
        await asyncio.sleep(max(begun + k / rate - loop.time(), 0.0))
        late.append(loop.time() - begun - k / rate)
    return late


@pytest.mark.wall_clock
def test_hundreds_of_clients_at_once_do_not_hold_a_sender_up(tmp_path):
    before, threads = descriptors(), threading.active_count()
    # From another process, as clients are: their own work is not the service's.
    script = textwrap.dedent("""
        import json, socket, sys, threading
        answers = []
        def one(kind):
            with socket.socket(socket.AF_UNIX) as c:
                c.settimeout(30.0)
                try:
                    c.connect(sys.argv[1])
                    if kind: c.sendall(b'{"do": "status"}\\n')
                    answers.append(json.loads(c.recv(4096)))
                except OSError as error:
                    answers.append(repr(error))
        threads = [threading.Thread(target=one, args=(k % 4,)) for k in range(200)]
        for t in threads: t.start()
        for t in threads: t.join()
        print(json.dumps(answers))
    """)

    async def main(path):
        loop = asyncio.get_running_loop()
        quiet = await ticking(1.0)
        command = [sys.executable, "-S", "-c", script, str(path)]
        crowd = loop.run_in_executor(None, lambda: subprocess.run(command, capture_output=True, text=True, check=True))
        busy = await ticking(4.0)
        return quiet, busy, json.loads((await crowd).stdout)

    with serving(tmp_path) as (served, path):
        quiet, busy, outcomes = asyncio.run(main(path))
        assert empty(served)
        assert client.ask(Status(), path)["ok"]
    assert len(outcomes) == 200
    served_well = [one for one in outcomes if isinstance(one, dict) and one["ok"]]
    refused = [one for one in outcomes if isinstance(one, dict) and not one["ok"]]
    # Every client that said something was answered; the fifty silent ones were sent away in words.
    assert len(served_well) == 150 and len(refused) == 50
    assert len(busy) == int(4.0 * 250) - 1
    print(
        f"lateness p99 {sorted(quiet)[-len(quiet) // 100] * 1e3:.2f} → {sorted(busy)[-len(busy) // 100] * 1e3:.2f} ms"
    )
    assert descriptors() == before and threading.active_count() <= threads + 1  # the loop's own pool


def test_a_socket_left_behind_is_taken_over_and_one_in_use_is_not(tmp_path):
    path = tmp_path / "control.sock"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    with serving(tmp_path) as (_, path):
        with pytest.raises(BadInputError, match="cannot listen there"):
            ControlServer(path, lambda *_: {"ok": True})
        assert client.ask(Status(), path)["ok"]


def test_nobody_there_is_told_with_the_mend(tmp_path):
    with pytest.raises(BadInputError, match=r"no service listens there; start it with `systemctl start flightapp`"):
        client.ask(Status(), tmp_path / "control.sock")
    with pytest.raises(BadInputError, match=r"cannot listen there.*--socket"):
        ControlServer(tmp_path / "nowhere" / "control.sock", lambda *_: {"ok": True})
