"""Packages of somebody else that bring modules of their own, installed where only the process that asks finds them."""

import os
import subprocess
import sys


def installed(package, place):
    """The environment of a process that finds ``package``, a directory, installed in ``place``."""
    pip = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    wanted = ["--no-index", "--no-deps", "--no-build-isolation", "--target", str(place), str(package)]
    subprocess.run([*pip, *wanted], check=True, timeout=120)
    return {**os.environ, "PYTHONPATH": str(place), "COLUMNS": "500"}
