"""A compiled kernel is stale when anything that it imports has changed."""

import subprocess
import sys
from pathlib import Path

from flightapp.control import flatness
from flightapp.jitcache import sources


def test_the_sources_of_a_kernel_include_what_it_imports_however_far_away():
    names = {path.name for path in sources(Path(flatness.__file__))}
    assert {"flatness.py", "trajectory.py", "frames.py", "jit.py"} <= names
    assert "cli.py" not in names


def test_a_changed_constant_of_another_module_is_not_flown_with_old_code(tmp_path):
    package = tmp_path / "sim"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "kernels.py").write_text(
        "from flightapp.jit import kernel\n"
        "from sim.constants import ANSWER\n\n\n"
        "@kernel\ndef answer():\n    return ANSWER\n"
    )

    def ask(value):
        (package / "constants.py").write_text(f"ANSWER = {value}.0\n")
        code = "import sys; sys.path.insert(0, '.'); from sim.kernels import answer; print(answer())"
        ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        return float(ended.stdout)

    assert ask(1) == 1.0
    assert ask(2) == 2.0
    assert list(package.glob("__pycache__/*.nbi"))
