"""Other processes, and what they do in their own time."""

import time
from pathlib import Path


def ended(process_id):
    """Whether it has ended, if only its parent hasn't noticed yet."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def wait_until(condition, timeout=5.0):
    """Wait until ``condition()``, so many seconds at most."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.02)
