"""Jobs for other processes, some of which these do not survive."""

import os
import signal
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
