import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightapp.config import Config, dump_config, load_config
from flightapp.frames import GRAVITY
from flightapp.inputs import BadInputError
from flightapp.perception.camera import Lens


def write(folder: Path, text: str) -> Path:
    path = folder / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def complaint(*overrides: str, vehicle: Path | None = None, mission: dict | None = None) -> str:
    with pytest.raises(BadInputError) as caught:
        load_config(vehicle, mission, overrides)
    return str(caught.value)


def test_defaults_are_valid() -> None:
    assert load_config() == Config()


def test_every_field_tells_what_it_is() -> None:
    for name in Config.model_fields:
        for key, field in type(getattr(Config(), name)).model_fields.items():
            assert field.description, f"{name}.{key}"


def test_later_layers_win(tmp_path: Path) -> None:
    path = write(tmp_path, "[race]\nv_max = 1.0\na_max = 2.0\ntimeout = 30.0\n[vehicle]\nname = 'f330'\n")
    config = load_config(path, {"race.v_max": 5.0, "race.a_max": 3.0}, ("race.v_max=7", "race.v_max = 6.5"))
    assert (config.race.v_max, config.race.a_max, config.race.timeout) == (6.5, 3.0, 30.0)
    assert config.vehicle.name == "f330"
    assert config.race.standoff == Config().race.standoff


def test_set_understands_every_type() -> None:
    config = load_config(
        overrides=(
            "sim.camera=corners",
            "recording.images=false",
            "mission.laps=3",
            "vehicle.drag=[0.3, 0.3, 0.1]",
            "camera.lens=fisheye",
            "vehicle.name=a=b",
        )
    )
    assert config.sim.camera == "corners"
    assert config.recording.images is False
    assert config.mission.laps == 3
    assert config.vehicle.drag == (0.3, 0.3, 0.1)
    assert config.camera.lens is Lens.FISHEYE
    assert config.vehicle.name == "a=b"


def test_missing_file() -> None:
    assert "none.toml: there is no such vehicle file" in complaint(vehicle=Path("none.toml"))


def test_syntax_error(tmp_path: Path) -> None:
    text = complaint(vehicle=write(tmp_path, "[race\nv_max = 3"))
    assert "vehicle.toml: not valid TOML" in text
    assert "line 1" in text


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("race.vmax=3", "--set race.vmax=3: unknown key 'race.vmax'; did you mean 'v_max'?"),
        ("rase.v_max=3", "--set rase.v_max=3: unknown key 'rase'; did you mean 'race'?"),
        ("race.v_max=nan", "--set race.v_max=nan: 'race.v_max' = nan: input should be "),
        ("race.v_max=inf", "--set race.v_max=inf: 'race.v_max' = inf: input should be "),
        ("race.v_max=-1", "--set race.v_max=-1: 'race.v_max' = -1: input should be greater than 0"),
        ("race.v_max=41", "--set race.v_max=41: 'race.v_max' = 41: input should be less than or equal to 40"),
        ("race.v_max=fast", "--set race.v_max=fast: 'race.v_max' = 'fast': input should be a valid number"),
        ("mission.laps=1.5", "--set mission.laps=1.5: 'mission.laps' = 1.5: input should be a valid integer"),
        ("vehicle.drag=[0.1, 0.2]", "--set vehicle.drag=[0.1, 0.2]: 'vehicle.drag.2' is missing"),
        ("vehicle.drag=[0, nan, 0]", "--set vehicle.drag=[0, nan, 0]: 'vehicle.drag.1' = nan: input should be a"),
        ("camera.lens=round", "--set camera.lens=round: 'camera.lens' = 'round': input should be 'pinhole' or"),
        ("camera.focal=[0,1,2,3]", "--set camera.focal=[0,1,2,3]: camera: focal lengths must be positive"),
        ("race.v_max", "--set race.v_max: expected section.key=value"),
        ("v_max=3", "--set v_max=3: 'v_max': expected section.key, with one of the sections vehicle, "),
        (".v_max=3", "--set .v_max=3: '.v_max': expected section.key"),
    ],
)
def test_bad_override_is_told_with_its_source_and_mend(override: str, expected: str) -> None:
    assert complaint(override).startswith(expected)


def test_mistake_is_told_with_the_layer_it_came_from(tmp_path: Path) -> None:
    path = write(tmp_path, "[race]\nv_max = 1.0\n[mission]\nlaps = 0\n")
    text = complaint("race.standoff=-1", vehicle=path, mission={"race.timeout": 0.0})
    assert f"{path}: 'mission.laps' = 0" in text
    assert "mission: 'race.timeout' = 0.0" in text
    assert "--set race.standoff=-1: 'race.standoff' = -1" in text


def test_section_that_is_no_table_is_told_even_when_a_later_layer_sets_a_key_of_it(tmp_path: Path) -> None:
    path = write(tmp_path, "race = 5\n")
    for overrides in ((), ("race.v_max=3",)):
        text = complaint(*overrides, vehicle=path)
        assert text.startswith(f"{path}: 'race' = 5: input should be a valid dictionary")


def test_acceleration_beyond_the_thrust_is_refused_with_what_would_fit() -> None:
    text = complaint("vehicle.thrust_to_weight=2.0", "race.a_max=20")
    fits = math.sqrt(3.0) * GRAVITY
    assert "race.a_max = 20.0 m/s² needs 22.3 m/s²" in text
    assert f"race.a_max may be at most {fits:.1f}" in text
    load_config(overrides=("vehicle.thrust_to_weight=2.0", f"race.a_max={fits - 0.01}"))


def test_speed_beyond_the_drag_is_refused_with_what_would_fit() -> None:
    text = complaint("vehicle.drag=[1.0, 1.0, 0.1]", "race.v_max=39", "control.tilt_max_deg=45")
    assert "race.v_max = 39.0 m/s cannot be flown" in text
    assert f"at {GRAVITY:.1f} m/s" in text


def test_dump_of_the_defaults_is_complete_and_explained() -> None:
    text = dump_config(Config())
    assert set(tomllib.loads(text)) == set(Config.model_fields)
    assert "v_max = 4.0 # m/s, greatest speed planned" in text


positive = st.floats(1e-3, 0.1, allow_nan=False)


@given(
    st.fixed_dictionaries(
        {
            "vehicle.name": st.text(max_size=20),
            "vehicle.drag": st.tuples(positive, positive, positive),
            "camera.lens": st.sampled_from(list(Lens)),
            "camera.distortion": st.tuples(*[st.floats(-1e3, 1e3)] * 4),
            "race.v_max": st.floats(1e-9, 4.0),
            "mission.laps": st.integers(1, 1000),
            "recording.images": st.booleans(),
            "planning.minimise": st.sampled_from(["acceleration", "jerk", "snap"]),
            "sim.gust": st.floats(0.0, 5.0),
        }
    )
)
def test_dump_leads_back(settings: dict[str, object]) -> None:
    config = load_config(mission=settings)
    assert Config.model_validate(tomllib.loads(dump_config(config))) == config


def test_dumped_file_can_be_loaded(tmp_path: Path) -> None:
    config = load_config(overrides=("race.v_max=3.25", "camera.lens=fisheye"))
    assert load_config(write(tmp_path, dump_config(config))) == config


def test_camera_section_makes_the_camera() -> None:
    config = load_config(overrides=("camera.pitch_up_deg=30", "camera.focal=[300, 310, 320, 240]"))
    model = config.camera.model()
    np.testing.assert_allclose(model.R_bc @ (0.0, 0.0, 1.0), (math.cos(math.pi / 6), 0.0, 0.5), atol=1e-12)
    np.testing.assert_array_equal(model.matrix, [[300.0, 0.0, 320.0], [0.0, 310.0, 240.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(model.p_bc, config.camera.position)
