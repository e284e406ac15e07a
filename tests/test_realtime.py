"""What is asked of the operating system, granted or not, and put back. As an ordinary user much is refused."""

import ctypes
import errno
import gc
import os
import resource
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from flightapp import realtime as module
from flightapp.config import Realtime
from flightapp.realtime import RealtimeReport, RealtimeSession, Step, describe, undisturbed

FIFO = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
LINK = (os.SCHED_FIFO, 7)
NOTHING = Realtime(priority=0, lock_memory=False)
ONLY_FIFO = Realtime(priority=7, lock_memory=False)


class Kernel:
    """An operating system that grants, or refuses, and remembers."""

    def __init__(self, monkeypatch, permitted=True, memory=resource.RLIM_INFINITY, capable=False):
        self.permitted = permitted
        self.policies, self.affinity, self.calls = {}, {}, []
        self.threads = [threading.get_native_id()]
        self.cpus = {0, 1, 2, 3}
        monkeypatch.setattr(os, "sched_setscheduler", self.set_policy)
        monkeypatch.setattr(os, "sched_getscheduler", lambda tid: self.policies.get(tid, (os.SCHED_OTHER, 0))[0])
        monkeypatch.setattr(
            os, "sched_getparam", lambda tid: os.sched_param(self.policies.get(tid, (os.SCHED_OTHER, 0))[1])
        )
        monkeypatch.setattr(os, "sched_getaffinity", lambda tid: self.affinity.get(self.real(tid), self.cpus))
        monkeypatch.setattr(os, "sched_setaffinity", lambda tid, cpus: self.affinity.update({self.real(tid): cpus}))
        monkeypatch.setattr(resource, "getrlimit", lambda _: (memory, memory))
        monkeypatch.setattr(module, "_capable", lambda _: capable)
        monkeypatch.setattr(module, "_threads", lambda: list(self.threads))
        library = SimpleNamespace(mlockall=self.lock, munlockall=lambda: self.calls.append("munlockall"))
        monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: library)

    @staticmethod
    def real(tid):
        return tid or threading.get_native_id()

    def set_policy(self, tid, policy, parameter):
        if not self.permitted:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
        if tid not in self.threads:
            raise ProcessLookupError(errno.ESRCH, os.strerror(errno.ESRCH))
        self.policies[tid] = (policy, parameter.sched_priority)

    def lock(self, flags):
        self.calls.append(("mlockall", flags))
        if self.permitted:
            return 0
        ctypes.set_errno(errno.EPERM)
        return -1


def steps(session):
    return {step.what: step for step in session.report.steps}


def test_all_granted_and_all_put_back(monkeypatch):
    kernel = Kernel(monkeypatch)
    here = threading.get_native_id()
    with RealtimeSession(Realtime(priority=42, cpus=(1, 3))) as session:
        assert session.report.granted
        assert kernel.policies[here] == (FIFO, 42)
        assert kernel.affinity[here] == {1, 3}
        assert kernel.calls == [("mlockall", 3)]
        assert set(steps(session)) == {"memory locked", "CPUs 1, 3", "SCHED_FIFO for the event loop"}
    assert kernel.policies[here] == (os.SCHED_OTHER, 0)
    assert kernel.affinity[here] == {0, 1, 2, 3}
    assert kernel.calls[-1] == "munlockall"


def test_what_an_ordinary_user_may_not_is_told_with_how_to_permit_it(monkeypatch):
    kernel = Kernel(monkeypatch, permitted=False, memory=8 << 20)
    with RealtimeSession(Realtime(priority=42, cpus=(9,))) as session:
        told = steps(session)
    assert not any(step.granted for step in told.values())
    assert "LimitRTPRIO=42" in told["SCHED_FIFO for the event loop"].detail
    assert "CAP_SYS_NICE" in told["SCHED_FIFO for the event loop"].detail
    assert "at most 8 MB" in told["memory locked"].detail
    assert "ulimit -l unlimited" in told["memory locked"].detail
    assert "no CPU 9" in told["CPUs 9"].detail
    assert (kernel.policies, kernel.affinity, kernel.calls) == ({}, {}, [])


def test_memory_is_not_locked_below_a_limit_that_would_fail_allocations_in_flight(monkeypatch):
    kernel = Kernel(monkeypatch, memory=2 << 30)
    with RealtimeSession(Realtime(priority=0)) as session:
        assert not session.report.granted
    assert not kernel.calls


def test_memory_is_locked_beyond_the_limit_by_who_is_capable(monkeypatch):
    kernel = Kernel(monkeypatch, memory=8 << 20, capable=True)
    with RealtimeSession(Realtime(priority=0)) as session:
        assert session.report.granted
    assert kernel.calls == [("mlockall", 3), "munlockall"]


def test_a_kernel_that_refuses_to_lock_is_told(monkeypatch):
    Kernel(monkeypatch, permitted=False)
    monkeypatch.setattr(ctypes, "get_errno", lambda: errno.EPERM)
    with RealtimeSession(Realtime(priority=0)) as session:
        assert steps(session)["memory locked"].detail.startswith("Operation not permitted")


def test_only_the_links_own_threads_are_adopted(monkeypatch):
    kernel = Kernel(monkeypatch)
    with RealtimeSession(ONLY_FIFO) as session:
        stop = threading.Event()
        with session.adopting("MAVSDK"):
            worker = threading.Thread(target=stop.wait)
            worker.start()
            kernel.threads += [worker.native_id, 900001, 900002]
        stop.set()
        worker.join()
        # What the link's threads start inherits FIFO; what the loop starts does not.
        assert kernel.policies == {threading.get_native_id(): (FIFO, 7), 900001: LINK, 900002: LINK}
        assert steps(session)["SCHED_FIFO for MAVSDK's threads"] == Step(
            "SCHED_FIFO for MAVSDK's threads", True, "priority 7, 2 threads"
        )
        kernel.threads.remove(900002)
    assert kernel.policies[900001] == (os.SCHED_OTHER, 0)


def test_threads_adopted_before_the_session_are_prioritised_once_it_begins(monkeypatch):
    kernel = Kernel(monkeypatch)
    session = RealtimeSession(ONLY_FIFO)
    with session.adopting("the link"):
        kernel.threads.append(900001)
    assert kernel.policies == {}
    with session:
        assert kernel.policies[900001] == LINK
        kernel.threads.append(900003)
        kernel.policies[900003] = LINK
        assert steps(session)["SCHED_FIFO for the link's threads"].granted
    assert kernel.policies[900001] == kernel.policies[900003] == (os.SCHED_OTHER, 0)


def test_a_link_without_threads_of_its_own_needs_nothing(monkeypatch):
    Kernel(monkeypatch)
    with RealtimeSession(ONLY_FIFO) as session, session.adopting("the link"):
        pass
    assert set(steps(session)) == {"SCHED_FIFO for the event loop"}


def test_an_adopted_thread_that_has_ended_is_told(monkeypatch):
    kernel = Kernel(monkeypatch)
    session = RealtimeSession(ONLY_FIFO)
    with session.adopting("the link"):
        kernel.threads.append(900001)
    kernel.threads.remove(900001)
    with session:
        assert steps(session)["SCHED_FIFO for the link's threads"].detail == "a thread ended meanwhile"


def test_what_is_not_asked_for_is_left_alone(monkeypatch):
    kernel = Kernel(monkeypatch)
    with RealtimeSession(NOTHING) as session, session.adopting("MAVSDK"):
        pass
    assert session.report == RealtimeReport(())
    assert (kernel.policies, kernel.affinity, kernel.calls) == ({}, {}, [])
    assert describe(session.report) == "real time: nothing asked for"


def test_a_failure_inside_puts_everything_back(monkeypatch):
    kernel = Kernel(monkeypatch)
    with pytest.raises(RuntimeError, match="inside"), RealtimeSession(Realtime()):
        raise RuntimeError("inside")
    assert kernel.policies[threading.get_native_id()] == (os.SCHED_OTHER, 0)
    assert kernel.calls[-1] == "munlockall"


def test_one_line_tells_all():
    report = RealtimeReport(
        (
            Step("memory locked", True, "512 MB resident"),
            Step("SCHED_FIFO for the event loop", False, "refused; permit it by LimitRTPRIO=50"),
        )
    )
    line = describe(report)
    assert line == (
        "real time: granted: memory locked (512 MB resident);"
        " NOT permitted: SCHED_FIFO for the event loop (refused; permit it by LimitRTPRIO=50)"
    )
    assert not report.granted


def test_on_this_machine_workers_stay_ordinary_whatever_is_granted():
    def policy():
        return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    with RealtimeSession(ONLY_FIFO) as session, ThreadPoolExecutor(1) as pool:
        assert policy() == (os.SCHED_FIFO if session.report.granted else before[0])
        assert pool.submit(policy).result() == os.SCHED_OTHER
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


def test_undisturbed_is_over_at_the_end():
    interval = sys.getswitchinterval()
    with undisturbed():
        assert not gc.isenabled()
        assert sys.getswitchinterval() == pytest.approx(2e-4)
        assert gc.get_freeze_count() > 0
    assert gc.isenabled()
    assert sys.getswitchinterval() == interval
    assert gc.get_freeze_count() == 0
