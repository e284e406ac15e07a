"""Jobs for other processes, some of which these do not survive."""

import gc
import os
import signal
import time
import weakref
from pathlib import Path

from flightapp.campaign.pool import work


def square(job):
    """(number, what becomes of the process): its square, unless the process ends."""
    number, fate = job
    if fate == "raises":
        raise ValueError(f"not {number}")
    if fate == "is killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if fate == "exits":
        os._exit(3)
    if isinstance(fate, Path) and not fate.exists():
        fate.touch()
        os.kill(os.getpid(), signal.SIGSEGV)
    return number * number


def process(_):
    """The process that does the job."""
    return os.getpid()


LEFT = []


class Loop:
    """What only the collector finds."""

    def __init__(self):
        self.itself = self


def left(_):
    """How many of what jobs in this process have left are still there; in a flight the collector is off."""
    gc.disable()
    LEFT.append(weakref.ref(Loop()))
    return sum(reference() is not None for reference in LEFT)


def linger(note):
    """Write this process's number into the file ``note``, and stay."""
    note.write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(60.0)


def ask_to_linger(note):
    """Have `linger` done by a process of a pool."""
    list(work(linger, [note], 1))
