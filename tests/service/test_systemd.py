"""Units, rules and the install script."""

import configparser
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from flightapp.behaviors.coordinator import LETTING_GO
from flightapp.behaviors.emergency import NEWS, STOPPING
from flightapp.config import Config
from flightapp.mission.supervisor import LAST_WORDS
from flightapp.service import client
from flightapp.service.peer import GROUP

ROOT = Path(__file__).parents[2]
SYSTEMD = ROOT / "systemd"
UNITS = ("flightapp.service", "flightapp-t265.service")
INSTALL = SYSTEMD / "install.sh"
analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze here")
EXPOSURE = 3.0


def install(root, *options):
    command = [str(INSTALL), "--root", str(root), *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def installed(root, *options):
    done = install(root, "--app", "/opt/flightapp", *options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def tree(root):
    """Every path below ``root`` with its mode and contents."""
    return {
        str(path.relative_to(root)): (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"")
        for path in sorted(root.rglob("*"))
    }


def unit(path):
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters="=")
    parser.optionxform = str
    parser.read(path)
    return parser["Service"]


@analyze
@pytest.mark.parametrize("name", UNITS)
def test_systemd_finds_nothing_wrong_with_a_unit(name):
    done = subprocess.run(
        ["systemd-analyze", "verify", str(SYSTEMD / name)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@analyze
def test_nor_with_what_is_installed(tmp_path):
    installed(tmp_path, "--udp-link", "--csi-camera")
    for program in ("usr/bin/env", "usr/bin/python3", "bin/kill"):
        (tmp_path / program).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / program).write_text("#!/bin/sh\n")
        (tmp_path / program).chmod(0o755)
    for target in ("sysinit", "basic", "multi-user", "shutdown"):
        place = tmp_path / "usr/lib/systemd/system" / f"{target}.target"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("[Unit]\nDescription=stands in\n")
    command = ["systemd-analyze", "verify", f"--root={tmp_path}", *UNITS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@analyze
@pytest.mark.parametrize("name", UNITS)
def test_a_unit_is_not_exposed(name):
    threshold = f"--threshold={round(10 * EXPOSURE)}"
    command = ["systemd-analyze", "security", "--offline=true", threshold, str(SYSTEMD / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd cannot judge a unit that is not installed")
    assert done.returncode == 0, done.stdout
    found = re.search(r"exposure level for .*: (\d+\.\d+)", done.stdout)
    assert found is not None and float(found[1]) <= EXPOSURE


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="there is no systemd-sysusers here")
def test_the_user_can_be_made(tmp_path):
    installed(tmp_path)
    command = ["systemd-sysusers", f"--root={tmp_path}", "--dry-run", "flightapp.conf"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-sysusers has no --dry-run")
    assert done.returncode == 0 and f"Creating user '{GROUP}'" in done.stderr


def test_the_unit_leaves_time_for_the_worst_landing():
    config, closing = Config(), 20.0
    worst = 2.0 * LETTING_GO + STOPPING + NEWS + config.mission.land_timeout + LAST_WORDS + closing
    assert float(unit(SYSTEMD / UNITS[0])["TimeoutStopSec"]) >= worst


def test_the_unit_permits_what_a_flight_asks_for_and_never_restarts_into_one():
    service = unit(SYSTEMD / UNITS[0])
    assert int(service["LimitRTPRIO"]) >= Config().realtime.priority
    assert service["LimitMEMLOCK"] == "infinity"
    assert (service["Type"], service["Restart"], service["KillMode"]) == ("notify", "on-failure", "mixed")
    assert f"FLIGHTAPP_SOCKET={client.SOCKET}" in service["Environment"]
    assert "flightapp serve " in service["ExecStart"] and "start" not in service["ExecStart"].split()
    assert "PrivateUsers" not in service  # it would hide who asks


def test_installing_twice_changes_nothing_and_uninstalling_leaves_nothing(tmp_path):
    installed(tmp_path, "--udp-link")
    first = tree(tmp_path)
    assert set(first) >= {f"etc/systemd/system/{name}" for name in UNITS}
    assert {"etc/udev/rules.d/60-flightapp.rules", "etc/flightapp/flightapp.env"} <= set(first)
    again = installed(tmp_path, "--udp-link")
    assert tree(tmp_path) == first and "install -m" not in again and "mkdir" not in again
    done = install(tmp_path, "--uninstall")
    assert done.returncode == 0, done.stderr
    assert tree(tmp_path) == {}
    done = install(tmp_path, "--uninstall")
    assert done.returncode == 2 and "nothing of flightapp is installed" in done.stderr


def test_a_dry_run_says_all_and_does_nothing(tmp_path):
    said = installed(tmp_path, "--dry-run")
    assert tree(tmp_path) == {}
    assert all(f"{tmp_path}/etc/systemd/system/{name}" in said for name in UNITS)
    assert all(line.startswith("would: ") for line in said.splitlines() if str(tmp_path) in line)
    installed(tmp_path)
    whole = tree(tmp_path)
    said = install(tmp_path, "--uninstall", "--dry-run").stdout
    assert tree(tmp_path) == whole and "would: rm -f" in said


def test_what_others_put_there_stays(tmp_path):
    (tmp_path / "etc/udev/rules.d").mkdir(parents=True)
    (tmp_path / "etc/udev/rules.d/99-other.rules").write_text("")
    before = tree(tmp_path)
    installed(tmp_path)
    mine = tmp_path / "etc/systemd/system/flightapp.service.d"
    mine.mkdir()
    (mine / "override.conf").write_text("[Service]\nNice=-1\n")
    said = install(tmp_path, "--uninstall").stdout
    assert f"keep {mine.parent}" in said
    assert (mine / "override.conf").is_file()
    shutil.rmtree(tmp_path / "etc/systemd")
    assert tree(tmp_path) == before


def test_the_options_of_the_service_are_the_users_own(tmp_path):
    installed(tmp_path)
    own = tmp_path / "etc/flightapp/flightapp.env"
    own.write_text('FLIGHTAPP_OPTIONS="--sim"\n')
    assert f"keep {own}" in installed(tmp_path)
    assert own.read_text() == 'FLIGHTAPP_OPTIONS="--sim"\n'
    assert f"keep {own}" in install(tmp_path, "--uninstall").stdout
    assert set(tree(tmp_path)) == {"etc", "etc/flightapp", "etc/flightapp/flightapp.env"}


def test_another_place_and_interpreter_get_into_the_units(tmp_path):
    done = install(tmp_path, "--app", "/srv/drone", "--t265-python", "/opt/python3.9/bin/python3")
    assert done.returncode == 0, done.stderr
    service, bridge = ((tmp_path / "etc/systemd/system" / name).read_text() for name in UNITS)
    assert "/opt/flightapp" not in service + bridge
    assert "Environment=PATH=/srv/drone/.venv/bin:" in service
    assert "\nExecStart=/opt/python3.9/bin/python3 /srv/drone/flightapp/sensors/t265_bridge.py " in bridge
    assert not (tmp_path / "etc/systemd/system/flightapp.service.d").exists()


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--app", "/home/me/flightapp"), "clone to /opt/flightapp"),
        (("--app", "flightapp"), "absolute path"),
        (("--app", "/opt/my apps"), "without blanks"),
        (("--app",), "takes a value"),
        (("--everything",), "unknown option"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_done(tmp_path, options, why):
    done = install(tmp_path, *options)
    assert done.returncode == 2 and why in done.stderr
    assert tree(tmp_path) == {}


def test_the_script_that_is_installed_runs_the_command(tmp_path):
    installed(tmp_path)
    script = tmp_path / "usr/local/bin/flightapp"
    assert os.access(script, os.X_OK)
    assert script.read_text() == '#!/bin/sh\nexec /opt/flightapp/.venv/bin/flightapp "$@"\n'


def test_the_bridge_sends_to_where_the_service_listens():
    options = (SYSTEMD / "flightapp.env").read_text()
    address = re.search(r"sensors\.pose_address=(\S+?)[\"\s]", options)
    assert address is not None
    assert unit(SYSTEMD / UNITS[1])["ExecStart"].endswith(f" {address[1]}")
    assert address[1].startswith("/run/flightapp/")


def test_the_rules_name_the_tracker_and_the_autopilot():
    lines = [line for line in (SYSTEMD / "60-flightapp.rules").read_text().splitlines() if line and line[0] != "#"]
    part = re.compile(r'[A-Z_]+(\{[A-Za-z_]+\})?(==|!=|=|\+=)"[^"]*"')
    assert all(part.fullmatch(one) for line in lines for one in line.split(", ")), lines
    text = "\n".join(lines)
    for vendor, product in (("8087", "0b37"), ("03e7", "2150")):
        assert f'ATTR{{idVendor}}=="{vendor}", ATTR{{idProduct}}=="{product}", GROUP="{GROUP}"' in text
