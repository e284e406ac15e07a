from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field

from flightapp.inputs import BadInputError, Location, read_toml, validate


class Wheel(BaseModel):
    model_config = ConfigDict(extra="forbid")

    radius: float = Field(0.3, gt=0.0, le=2.0)
    spokes: int = 32


class Cart(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str
    front: Wheel = Wheel()
    wheels: tuple[Wheel, ...] = ()
    spare: Wheel | None = None


def complaint(data: dict, source: object = "cart.toml") -> str:
    with pytest.raises(BadInputError) as caught:
        validate(Cart, data, source)
    return str(caught.value)


def test_good_input_becomes_a_model() -> None:
    cart = validate(Cart, {"name": "x", "wheels": [{"radius": 1}]}, "cart.toml")
    assert cart == Cart(name="x", wheels=(Wheel(radius=1.0),))


def test_value_out_of_bounds_is_told_with_source_key_value_and_bound() -> None:
    text = complaint({"name": "x", "front": {"radius": 3}})
    assert text == "cart.toml: 'front.radius' = 3: input should be less than or equal to 2"


def test_wrong_type_is_told() -> None:
    text = complaint({"name": "x", "front": {"spokes": "many"}})
    assert text.startswith("cart.toml: 'front.spokes' = 'many': input should be a valid integer")


def test_missing_key_is_told() -> None:
    assert complaint({}) == "cart.toml: 'name' is missing"


@pytest.mark.parametrize(
    ("data", "key", "nearest"),
    [
        ({"name": "x", "frnt": {}}, "frnt", "front"),
        ({"name": "x", "front": {"radios": 1.0}}, "front.radios", "radius"),
        ({"name": "x", "wheels": [{}, {"spoke": 3}]}, "wheels.1.spoke", "spokes"),
        ({"name": "x", "spare": {"radus": 1.0}}, "spare.radus", "radius"),
    ],
)
def test_unknown_key_is_told_with_the_nearest_known_one(data: dict, key: str, nearest: str) -> None:
    assert complaint(data) == f"cart.toml: unknown key '{key}'; did you mean '{nearest}'?"


def test_unknown_key_like_no_other_is_told_with_all_known_ones() -> None:
    assert complaint({"name": "x", "front": {"qqq": 1}}).endswith("'front.qqq'; known here: radius, spokes")


def test_every_mistake_is_told_at_once() -> None:
    text = complaint({"front": {"radius": -1.0}, "wheels": [{"spokes": []}]})
    assert "'name' is missing" in text
    assert "'front.radius' = -1.0" in text
    assert "'wheels.0.spokes'" in text


def test_source_may_depend_on_the_key() -> None:
    def source(location: Location) -> str:
        return f"where {location[0]} came from"

    assert complaint({"name": "x", "front": 3}, source).startswith("where front came from: 'front' = 3: ")


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"none\.toml: there is no such vehicle file"):
        read_toml(tmp_path / "none.toml", "vehicle file")


def test_syntax_error_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("a = 1\nb = = 2\n")
    with pytest.raises(BadInputError, match=r"bad\.toml: not valid TOML: .*line 2"):
        read_toml(path, "vehicle file")


@pytest.mark.parametrize("make", [lambda p: p.mkdir(), lambda p: p.write_bytes(b"\xff\xfe\x00")])
def test_what_is_no_text_file_is_told(tmp_path: Path, make: object) -> None:
    path = tmp_path / "odd.toml"
    make(path)
    with pytest.raises(BadInputError, match=r"odd\.toml: cannot be read"):
        read_toml(path, "vehicle file")
