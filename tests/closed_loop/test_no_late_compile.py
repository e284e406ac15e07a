"""Nothing is compiled, or loaded from the cache of kernels, between arming and landing."""

import subprocess
import sys
from pathlib import Path

import pytest

MISSIONS = Path(__file__).parents[2] / "missions"

WATCHED_FLIGHT = """
import contextlib, sys
from pathlib import Path
import numba.core.dispatcher as numba_dispatcher

kernels = []
original = numba_dispatcher.Dispatcher.__init__

def remembered(self, *args, **kwargs):
    original(self, *args, **kwargs)
    kernels.append(self)

numba_dispatcher.Dispatcher.__init__ = remembered
from flightapp import app

undisturbed = app.undisturbed

@contextlib.contextmanager
def watched():
    before = {id(kernel): len(kernel.signatures) for kernel in kernels}
    with undisturbed():
        yield
    for kernel in kernels:
        if len(kernel.signatures) > before.get(id(kernel), 0):
            print("late:", kernel.py_func.__module__, kernel.py_func.__qualname__)

app.undisturbed = watched
flown = app.fly(app.FlightPlan(Path(sys.argv[1]), Path(sys.argv[2]), overrides=tuple(sys.argv[3:]), seed=1030))
print(flown.ending.outcome)
"""


@pytest.mark.parametrize(
    ("mission", "camera", "controller"),
    [("five_gates", "rendered", "flatness"), ("one_gate", "corners", "flatness"), ("one_gate", "corners", "mpcc")],
)
def test_no_kernel_compiles_in_flight(tmp_path, mission, camera, controller):
    command = [
        sys.executable,
        "-c",
        WATCHED_FLIGHT,
        MISSIONS / f"{mission}.py",
        tmp_path / "run",
        f"sim.camera={camera}",
        f"control.controller={controller}",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert ended.stdout.split("\n")[:-1] == ["GOAL_ACHIEVED"]
