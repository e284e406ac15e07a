import pytest

from flightapp.inputs import BadInputError
from sim.vehicles import load_vehicle, vehicle_names


def test_all_vehicles_load_and_fly():
    assert vehicle_names() == ["px4", "iris", "f330", "racer", "limits"]
    for name in vehicle_names():
        assert load_vehicle(name).thrust_to_weight > 1.5


@pytest.mark.parametrize(("name", "ratio"), [("px4", 2.04), ("racer", 4.0), ("limits", 2.8)])
def test_thrust_to_weight(name, ratio):
    vehicle = load_vehicle(name)
    assert vehicle.thrust_to_weight == pytest.approx(ratio, abs=0.005)
    assert vehicle.hover_thrust == pytest.approx(1.0 / ratio, abs=0.001)


def test_rotor_speed_matches_thrust_on_the_measured_airframes():
    assert load_vehicle("f330").thrust_max == pytest.approx(7.94e-6 * (8000.0 * 2.0 * 3.14159265 / 60.0) ** 2, rel=0.01)
    assert load_vehicle("iris").thrust_max == pytest.approx(5.84e-6 * 1100.0**2, rel=0.01)


def test_an_unknown_vehicle_names_the_known_ones():
    with pytest.raises(BadInputError, match="known: px4, iris, f330, racer, limits"):
        load_vehicle("blimp")
