import math
import struct
from pathlib import Path

import pytest
from doctor_vehicle import good_values
from hypothesis import given
from hypothesis import strategies as st

from flightapp.autopilot.parameters import Bits, Kind, Parameter, Severity, Verdict, Within, compare, exactly
from flightapp.autopilot.params_file import params_text, write_params
from flightapp.autopilot.wanted_parameters import Profile, wanted_parameters
from flightapp.config import Config, load_config
from flightapp.inputs import BadInputError

INDOOR = Path(__file__).parents[2] / "config" / "px4_indoor.params"


def as_float32(value):
    return struct.unpack("f", struct.pack("f", value))[0]


def parameter(wanted, kind=Kind.INT, severity=Severity.MUST, **more):
    return Parameter("SOME_NAME", kind, wanted, severity, "term", "why", **more)


def verdict(wanted, value, kind=Kind.INT):
    return compare([parameter(wanted, kind)], {"SOME_NAME": value})[0].verdict


def table(profile=Profile.CAGE, **settings):
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in settings.items()]
    return {p.name: p for p in wanted_parameters(load_config(None, None, overrides), profile)}


@given(st.floats(min_value=1e-3, max_value=1e6))
def test_a_value_that_went_through_a_32_bit_float_is_still_the_wanted_one(value):
    assert verdict(exactly(value), as_float32(value), Kind.FLOAT) is Verdict.OK
    assert verdict(Within(value / 2, value), as_float32(value), Kind.FLOAT) is Verdict.OK
    assert verdict(exactly(value), 1.001 * value, Kind.FLOAT) is Verdict.DIFFERS


@given(st.integers(min_value=-(2**31), max_value=2**31 - 1), st.integers(min_value=1, max_value=1000))
def test_a_32_bit_integer_is_held_to_its_last_digit_while_it_is_small(value, off):
    assert verdict(exactly(value), value) is Verdict.OK
    if abs(value) < 2**20:
        assert verdict(exactly(value), value + off) is Verdict.DIFFERS


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_never_right(value):
    assert verdict(Within(-math.inf, math.inf), value, Kind.FLOAT) is Verdict.DIFFERS
    assert verdict(Bits(on=1), value) is Verdict.DIFFERS


def test_a_range_ends_where_it_says_and_choices_stand_beside_it():
    wanted = Within(0.1, 0.5, choices=(2,), write=0.5)
    taken = [value for value in (0.0, 0.09, 0.1, 0.3, 0.5, 0.51, 1.9, 2.0) if wanted.accepts(value)]
    assert taken == [0.1, 0.3, 0.5, 2.0]
    assert wanted.text == "0.1 to 0.5 or 2"


@given(st.integers(min_value=0, max_value=255))
def test_mending_bits_changes_no_other_bit(value):
    wanted = Bits(on=0b101, off=0b1000)
    new = wanted.mended(value)
    assert wanted.accepts(new)
    assert (new ^ value) & ~0b1101 == 0
    assert not wanted.accepts(new & ~1)
    assert not wanted.accepts(new | 8)


def test_what_was_not_read_and_what_is_not_there_are_told_apart():
    wanted = [parameter(exactly(1))]
    assert compare(wanted, {})[0].verdict is Verdict.UNREADABLE
    assert compare(wanted, {"SOME_NAME": None})[0].verdict is Verdict.MISSING
    assert all(found[0].mend is None for found in (compare(wanted, {}), compare(wanted, {"SOME_NAME": None})))


def test_a_note_is_never_written_and_neither_is_what_a_person_must_decide():
    note = compare([parameter(exactly(1), severity=Severity.NOTE)], {"SOME_NAME": 2})[0]
    by_hand = compare([parameter(Within(1, 18))], {"SOME_NAME": 0})[0]
    must = compare([parameter(exactly(1))], {"SOME_NAME": 2})[0]
    assert (note.verdict, by_hand.verdict, must.verdict) == (Verdict.DIFFERS,) * 3
    assert (note.mend, by_hand.mend, must.mend) == (None, None, 1)


def test_a_mended_value_has_the_type_that_px4_stores():
    for row in (*wanted_parameters(Config(), Profile.CAGE), *wanted_parameters(Config(), Profile.PILOT)):
        new = row.mended(None)
        assert new is None or type(new) is (int if row.kind is Kind.INT else float), row.name
        assert new is None or row.wanted.accepts(new), row.name


@pytest.mark.parametrize("profile", list(Profile))
def test_the_table_is_well_formed(profile):
    rows = wanted_parameters(Config(), profile)
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        assert 1 <= len(row.name) <= 16, row.name
        assert row.why and row.term and row.wanted.text, row.name
        assert not row.why.endswith(".") and not row.term.endswith("."), row.name


def test_what_was_measured_to_fly_without_a_remote_control_is_as_wanted():
    flown = {
        "EKF2_GPS_CTRL": 0, "SYS_HAS_GPS": 0, "EKF2_MAG_TYPE": 5, "SYS_HAS_MAG": 0, "EKF2_RNG_CTRL": 0,
        "EKF2_HGT_REF": 3, "EKF2_EV_CTRL": 15, "EKF2_EV_NOISE_MD": 1, "EKF2_EVP_NOISE": 0.02,
        "EKF2_EVA_NOISE": 0.02, "EKF2_EVV_NOISE": 0.05, "COM_RC_IN_MODE": 4, "COM_RCL_EXCEPT": 7, "NAV_DLL_ACT": 0,
        "COM_DLL_EXCEPT": 7, "COM_OF_LOSS_T": 0.5, "COM_OBL_RC_ACT": 4, "COM_ARM_WO_GPS": 2,
    }  # fmt: skip
    rows = table()
    assert all(rows[name].wanted.accepts(value) for name, value in flown.items())
    assert {name: rows[name].mended(None) for name in flown} == flown


def test_px4s_defaults_are_not_enough_for_an_indoor_flight():
    defaults = {
        "EKF2_GPS_CTRL": 7, "EKF2_MAG_TYPE": 0, "EKF2_HGT_REF": 1, "EKF2_EV_CTRL": 0, "COM_RC_IN_MODE": 3,
        "COM_RCL_EXCEPT": 0, "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0,
    }  # fmt: skip
    rows = table()
    wrong = {row.parameter.name for row in compare([rows[name] for name in defaults], defaults) if row.mend is not None}
    assert wrong == set(defaults)
    assert all(rows[name].severity is Severity.MUST for name in defaults)


def test_a_safety_pilot_keeps_the_failsafes_of_the_remote_control():
    rows = table(Profile.PILOT)
    assert not rows["COM_RC_IN_MODE"].wanted.accepts(4)
    assert not rows["COM_RCL_EXCEPT"].wanted.accepts(7)
    assert rows["COM_RCL_EXCEPT"].mended(7) == 3
    assert not rows["NAV_RCL_ACT"].wanted.accepts(0)
    assert not rows["RC_MAP_KILL_SW"].wanted.accepts(0)
    assert rows["RC_MAP_KILL_SW"].mended(0) is None
    assert rows["COM_RC_OVERRIDE"].mended(1) == 3


def test_the_message_decides_what_is_fused_and_timesync_how_late_it_is():
    assert table()["EKF2_EV_CTRL"].mended(0) == 15
    assert table(external_vision__message="position")["EKF2_EV_CTRL"].mended(0) == 11
    late = table(external_vision__delay=0.03)["EKF2_EV_DELAY"]
    assert late.mended(0.0) == 30.0
    assert late.wanted.accepts(33.0) and not late.wanted.accepts(0.0)
    synchronous = table(external_vision__delay=0.03, external_vision__timesync="true")["EKF2_EV_DELAY"]
    assert synchronous.mended(30.0) == 0.0
    assert not synchronous.wanted.accepts(30.0)


def test_the_vehicle_decides_hover_thrust_curve_and_address():
    rows = table(vehicle__hover_thrust=0.4, vehicle__thrust_to_weight=2.2, race__a_max=5, link__system_id=7)
    assert rows["MPC_THR_HOVER"].mended(0.5) == 0.4
    assert rows["MPC_THR_HOVER"].wanted.accepts(0.42) and not rows["MPC_THR_HOVER"].wanted.accepts(0.5)
    assert rows["MAV_SYS_ID"].mended(1) == 7
    assert rows["THR_MDL_FAC"].wanted.accepts(0.7)
    curved = table(vehicle__thrust_curve=0.3)["THR_MDL_FAC"]
    assert not curved.wanted.accepts(0.3)
    assert curved.mended(0.3) == 0.0


def test_compensating_the_battery_twice_is_found():
    assert "MC_BAT_SCALE_EN" not in table()
    row = table(vehicle__battery_scale="true")["MC_BAT_SCALE_EN"]
    assert not row.wanted.accepts(1)


def test_the_estimator_must_be_as_fast_as_the_odometry_that_is_asked_for():
    assert table()["EKF2_PREDICT_US"].wanted.accepts(10000)
    fast = table(link__odometry_rate=250)["EKF2_PREDICT_US"]
    assert not fast.wanted.accepts(10000)
    assert fast.mended(10000) == 4000


def test_a_tilt_that_is_flown_is_no_failure():
    row = table(control__tilt_max_deg=70)["FD_FAIL_R"]
    assert [row.wanted.accepts(value) for value in (60, 84, 85, 180, 0)] == [False, False, True, True, True]
    assert table(control__tilt_max_deg=170)["FD_FAIL_P"].mended(60) == 180


def test_over_usb_px4_needs_its_breaker_and_elsewhere_not():
    assert "CBRK_USB_CHK" not in table()
    assert table(link__connection="serial:///dev/ttyACM0:921600")["CBRK_USB_CHK"].mended(0) == 197848


def test_the_file_in_config_is_the_table():
    expected = params_text(wanted_parameters(Config()), Profile.CAGE)
    assert INDOOR.read_text(encoding="utf-8") == expected, "flightapp doctor --params config/px4_indoor.params"


def test_the_file_sets_what_differs_and_nothing_of_one_vehicle():
    rows = table()
    lines = [line.split("\t") for line in INDOOR.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert {(system, component) for system, component, *_ in lines} == {("1", "1")}
    names = [name for _, _, name, *_ in lines]
    assert len(set(names)) == len(names) > 20
    for _, _, name, value, kind in lines:
        assert int(kind) == rows[name].kind
        assert rows[name].wanted.accepts(float(value))
        assert "." not in value or rows[name].kind is Kind.FLOAT
    assert not {"MPC_THR_HOVER", "THR_MDL_FAC", "MAV_SYS_ID", "CBRK_SUPPLY_CHK"} & set(names)


@given(value=st.floats(width=32, allow_nan=False, allow_infinity=False), whole=st.integers(-(2**31), 2**31 - 1))
def test_a_file_holds_what_a_32_bit_float_and_integer_can(value, whole):
    rows = [
        Parameter("A_FLOAT", Kind.FLOAT, exactly(value), Severity.MUST, "term", "why"),
        Parameter("AN_INT", Kind.INT, exactly(whole), Severity.MUST, "term", "why"),
    ]
    real, integer = (line.split("\t") for line in params_text(rows, "test").splitlines() if not line.startswith("#"))
    assert integer[2:] == ["AN_INT", str(whole), "6"]
    assert real[2::2] == ["A_FLOAT", "9"]
    assert as_float32(float(real[3])) == pytest.approx(value, rel=5e-7)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(BadInputError, match="cannot be written"):
        write_params(tmp_path / "no" / "directory.params", [], "test")


def test_good_values_are_good():
    for profile in Profile:
        found = compare(wanted_parameters(Config(), profile), good_values(profile=profile))
        assert {f.parameter.name: f.value for f in found if f.verdict is not Verdict.OK} == {}
