"""`flightapp metrics`: any two paths, and what is wrong with them told in words."""

import json

import numpy as np
import pytest
import synthetic_flight as synthetic
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.tools import file_interface
from typer.testing import CliRunner

from flightapp.cli import cli
from flightapp.evaluation.alignment import Align
from flightapp.evaluation.paths import TimedPath
from flightapp.evaluation.pose_errors import Unit
from flightapp.inputs import BadInputError
from flightapp.interchange.compare import Options, Step, compare, comparison_tables, parse_step
from flightapp.interchange.text_files import write_csv, write_tum


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    out = tmp_path_factory.mktemp("poses")
    flight = synthetic.flight()
    write_tum(flight, out)
    write_csv(flight, out)
    return out


def test_the_command_says_what_evo_says(files):
    """From the same two files, by evo's own reader and association."""
    reference, estimate = files / "truth.tum", files / "state.tum"
    arguments = ["metrics", str(reference), str(estimate), "--align", "se3", "--rpe", "5f"]
    result = CliRunner().invoke(cli, [*arguments, "--json", str(files / "out.json")])
    assert result.exit_code == 0, result.output
    assert "APE, SE(3), m" in result.output
    said = json.loads((files / "out.json").read_text())
    a, b = (file_interface.read_tum_trajectory_file(str(path)) for path in (reference, estimate))
    a, b = sync.associate_trajectories(a, b)
    b.align(a)
    for relation, part in (("translation_part", "translation"), ("rotation_angle_rad", "rotation")):
        ape = evo_metrics.APE(evo_metrics.PoseRelation[relation])
        ape.process_data((a, b))
        rpe = evo_metrics.RPE(evo_metrics.PoseRelation[relation], 5)
        rpe.process_data((a, b))
        for ours, theirs in ((said["ape"]["se3"], ape), (said["rpe"], rpe)):
            for name, value in theirs.get_all_statistics().items():
                if name != "sse":
                    assert ours[part][name] == pytest.approx(value, rel=1e-9, abs=1e-9), (part, name)
    assert said["poses"]["compared"] == 2800
    assert list(said["ape"]) == ["se3"]


def test_csv_beside_tum(files):
    result = CliRunner().invoke(cli, ["metrics", str(files / "truth.tum"), str(files / "truth.csv"), "--interpolate"])
    assert result.exit_code == 0, result.output
    assert "read between its poses" in result.output
    for words in ("as it is", "first pose", "yaw and place", "SE(3)", "Sim(3)"):
        assert f"APE, {words}, m " in result.output
    assert "0.0000" in result.output


def walk(n=50, q=True):
    rng = np.random.default_rng(2)
    level = np.tile((1.0, 0.0, 0.0, 0.0), (n, 1)) if q else None
    return TimedPath("walk", np.arange(n) * 0.1, np.cumsum(rng.normal(size=(n, 3)), axis=0), level)


def test_clocks_that_differ_are_told_and_mended():
    path = walk()
    late = path.shifted(100.0)
    with pytest.raises(BadInputError, match=r"walk is from 0\.000 to 4\.900 s, walk is from 100\.000 .* --offset"):
        compare(path, late, Options())
    found = compare(path, late, Options(offset=-100.0))
    assert found["ape"]["none"]["translation"]["max"] < 1e-12


def test_without_orientations_what_needs_them_is_left_out_or_refused():
    path = walk(q=False)
    found = compare(path, path, Options())
    assert set(found["ape"]) == {"none", "yaw", "se3", "sim3"}
    assert found["ape"]["se3"]["rotation"] is None
    with pytest.raises(BadInputError, match=r"--align first: .*orientations"):
        compare(path, path, Options(Align.FIRST))
    with pytest.raises(BadInputError, match=r"--rpe: .*orientations"):
        compare(path, path, Options(step=Step(1.0, Unit.SECONDS)))
    (table,) = comparison_tables(found)
    assert len(table.rows) == 4


def test_a_scale_is_found_and_told():
    path = walk()
    larger = TimedPath("larger", path.stamp, 2.0 * path.position + 3.0, path.orientation)
    found = compare(path, larger, Options(step=Step(5, Unit.FRAMES), align=Align.SIM3))
    assert found["alignment"]["sim3"]["scale"] == pytest.approx(0.5)
    assert found["rpe"]["translation"]["max"] < 1e-9
    assert compare(path, larger, Options(step=Step(5, Unit.FRAMES)))["rpe"]["translation"]["max"] > 0.1


@pytest.mark.parametrize(("text", "step"), [("1s", (1.0, "s")), ("0.5m", (0.5, "m")), ("10f", (10.0, "frames"))])
def test_steps_are_read(text, step):
    found = parse_step(text)
    assert (found.delta, found.unit.value) == step


@pytest.mark.parametrize("text", ["", "1", "s", "0s", "1.5f", "-1m", "1 s", "1km", "nans"])
def test_steps_that_are_none_are_refused(text):
    with pytest.raises(BadInputError, match=r"such as 1s, 5m or 10f"):
        parse_step(text)


def test_a_step_longer_than_the_path_is_told():
    with pytest.raises(BadInputError, match="no step of 99 s"):
        compare(walk(), walk(), Options(step=Step(99.0, Unit.SECONDS)))
