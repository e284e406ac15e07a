"""Jobs for other processes, some of which these do not survive."""

import gc
import os
import signal
import weakref
from pathlib import Path


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
