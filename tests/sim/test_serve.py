"""The simulated autopilot served alone."""

import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest

from flightapp.config import load_config
from flightapp.inputs import BadInputError
from flightapp.sensors.poses import POSE_RECORD
from sim.live import set_parameter
from sim.px4.parameters import Parameters
from sim.serve import serve_alone

SERVE = """
import sys
from flightapp.config import load_config
from sim.serve import serve_alone
serve_alone(
    load_config(),
    remotes=sys.argv[1:2],
    parameters=["MPC_THR_HOVER=0.3"],
    poses_to=sys.argv[2],
    announce=lambda line: print(line, flush=True),
)
print("ended")
"""


@contextmanager
def receiver(path=None):
    """A datagram socket that waits two seconds at most, and its address."""
    with socket.socket(socket.AF_INET if path is None else socket.AF_UNIX, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0) if path is None else str(path))
        opened.settimeout(2.0)
        yield opened


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_a_signal_and_ends_well(tmp_path, number):
    with receiver() as mavlink, receiver(tmp_path / "poses") as poses:
        port = mavlink.getsockname()[1]
        command = [sys.executable, "-c", SERVE, f"127.0.0.1:{port}", str(tmp_path / "poses")]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            line = process.stdout.readline()
            assert f"127.0.0.1:{port}" in line
            assert "internal vision" in line
            assert mavlink.recv(512)[0] == 0xFD, "MAVLink 2"
            record = np.frombuffer(poses.recv(512), POSE_RECORD)[0]
            assert abs(record["position"]).max() < 0.1
            assert record["confidence"] == 3
            os.kill(process.pid, number)
            assert process.stdout.read() == "ended\n"
        assert process.returncode == 0


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"remotes": ["nowhere"]}, "nowhere"),
        ({"remotes": ["8.8.8.8:14540"]}, "this computer"),
        ({"remotes": ["/run/here"]}, "UDP port"),
        ({"poses_to": "10.1.1.1:5601"}, "this computer"),
    ],
)
def test_addresses_are_checked_before_it_starts(changes, told):
    with pytest.raises(BadInputError, match=told):
        serve_alone(load_config(), announce=pytest.fail, **changes)


def test_parameters_are_set_in_px4s_types():
    parameters = Parameters()
    set_parameter(parameters, "COM_OBL_RC_ACT=2")
    set_parameter(parameters, " COM_OF_LOSS_T = 1 ")
    assert parameters["COM_OBL_RC_ACT"] == 2
    assert isinstance(parameters["COM_OF_LOSS_T"], float)
    for text, told in (
        ("COM_OBL_RC_ACT", "NAME=VALUE"),
        ("COM_OBL_RC_ACT=1.5", "whole number"),
        ("COM_OF_LOSS_T=soon", "a number"),
        ("COM_OF_LOSS_T=nan", "a number"),
        ("COM_OF_LOS_T=1", "COM_OF_LOSS_T"),
    ):
        with pytest.raises(BadInputError, match=told):
            set_parameter(parameters, text)
