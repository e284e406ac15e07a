"""Linux's timerfd: a timer that is a file, ready to be read when it has expired (timerfd_create(2)).

Python has it from 3.13 on (`os.timerfd_create`); this is the same for the versions before.
"""

import ctypes
import os
import time

NONBLOCK, CLOEXEC = os.O_NONBLOCK, os.O_CLOEXEC
"""TFD_NONBLOCK and TFD_CLOEXEC are these flags."""
ABSOLUTE = 1
"""TFD_TIMER_ABSTIME."""


class _TimerSpec(ctypes.Structure):
    """struct itimerspec: interval, then expiration, each in seconds and nanoseconds."""

    _fields_ = (
        ("interval_s", ctypes.c_long),
        ("interval_ns", ctypes.c_long),
        ("value_s", ctypes.c_long),
        ("value_ns", ctypes.c_long),
    )


class KernelTimer:
    """One timer on CLOCK_MONOTONIC, set anew for each expiration. Raises OSError where there is none to be had."""

    def __init__(self) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        if not hasattr(libc, "timerfd_create"):
            raise OSError("this system has no timerfd: it is Linux's")
        self._settime = libc.timerfd_settime
        self._settime.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
        self._fd: int = libc.timerfd_create(time.CLOCK_MONOTONIC, NONBLOCK | CLOEXEC)
        if self._fd < 0:
            raise _error("timerfd_create")
        self._spec = _TimerSpec()
        self._at = ctypes.addressof(self._spec)

    @property
    def closed(self) -> bool:
        """Whether it was given back."""
        return self._fd < 0

    def fileno(self) -> int:
        """The descriptor, readable from the expiration until `expired` or `set`."""
        return self._fd

    def set(self, when: float) -> None:
        """Expire at ``when`` (s, `time.monotonic`), at once where that has passed."""
        # All zero would stop the timer instead.
        nanoseconds = max(round(when * 1e9), 1)
        self._spec.value_s, self._spec.value_ns = divmod(nanoseconds, 1_000_000_000)
        if self._settime(self._fd, ABSOLUTE, self._at, None) != 0:
            raise _error("timerfd_settime")

    def expired(self) -> bool:
        """Whether it has expired since it was set; tells it once."""
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        """Give the descriptor back."""
        if not self.closed:
            os.close(self._fd)
            self._fd = -1


def _error(call: str) -> OSError:
    number = ctypes.get_errno()
    return OSError(number, f"{call}: {os.strerror(number)}")
