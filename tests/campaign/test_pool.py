"""Work in processes, some of which die."""

from multiprocessing import get_context

import fates
import pytest
from processes import ended, wait_until

from flightapp.campaign.pool import TIDIED, Lost, work


def test_every_job_is_done_in_processes_that_are_started_once():
    assert dict(work(fates.square, [(n, "") for n in range(20)], 2)) == {n: n * n for n in range(20)}
    assert len({pid for _, pid in work(fates.process, range(20), 2)}) <= 2


def test_a_process_that_dies_loses_only_its_job_and_that_is_tried_again(tmp_path):
    jobs = [(0, ""), (1, tmp_path / "once"), (2, ""), (3, "is killed"), (4, "exits"), (5, "")]
    done = dict(work(fates.square, jobs, 2))
    assert {n: done[n] for n in (0, 1, 2, 5)} == {0: 0, 1: 1, 2: 4, 5: 25}
    assert done[3] == Lost("its process was killed by SIGKILL, 3 times")
    assert done[4] == Lost("its process ended with exit status 3, 3 times")


def test_what_a_job_raises_is_raised():
    with pytest.raises(ValueError, match="not 1"):
        list(work(fates.square, [(0, ""), (1, "raises"), (2, "")], 1))


def test_no_jobs_need_no_processes():
    assert list(work(fates.square, [], 2)) == []


def test_what_jobs_leave_is_thrown_away():
    left = dict(work(fates.left, range(3 * TIDIED), 1))
    assert max(left.values()) == TIDIED


def test_processes_do_not_outlive_the_one_that_asks(tmp_path):
    note = tmp_path / "pid"
    asking = get_context("spawn").Process(target=fates.ask_to_linger, args=(note,))
    asking.start()
    wait_until(lambda: note.exists() and note.read_text(encoding="utf-8"), 20.0)
    asking.kill()
    asking.join()
    wait_until(lambda: ended(int(note.read_text(encoding="utf-8"))))
