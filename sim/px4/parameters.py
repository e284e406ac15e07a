"""PX4's parameters: the ones that the model acts on, typed as PX4 has them, with the values of an indoor vehicle.

Names, types and defaults are those of PX4's parameter reference (v1.16); what differs from the defaults is the
indoor set for external vision without radio control.
"""

from collections.abc import Iterator, Mapping

Value = int | float

ACTING: dict[str, Value] = {
    # Commander.
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "COM_ARM_WO_GPS": 2,
    "COM_DISARM_LAND": 1.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_FAIL_ACT_T": 5.0,
    "COM_LOW_BAT_ACT": 0,
    "COM_OBL_RC_ACT": 4,
    "COM_OF_LOSS_T": 0.5,
    "COM_RC_IN_MODE": 4,
    "COM_RCL_EXCEPT": 7,
    "COM_SPOOLUP_TIME": 1.0,
    "NAV_RCL_ACT": 2,
    # Flying by itself.
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_SPEED": 0.6,
    "MPC_THR_HOVER": 0.5,
    "MPC_TKO_SPEED": 1.5,
    # EKF2.
    "EKF2_BARO_CTRL": 1,
    "EKF2_EVP_GATE": 5.0,
    "EKF2_EVP_NOISE": 0.02,
    "EKF2_EVV_GATE": 3.0,
    "EKF2_EVV_NOISE": 0.05,
    "EKF2_EV_CTRL": 15,
    "EKF2_EV_DELAY": 0.0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_HGT_REF": 3,
    "EKF2_NOAID_TOUT": 5000000,
}
"""Read by the model, but for EKF2_HGT_REF, without which vision gives the height too; others have no effect on it."""


class Parameters(Mapping[str, Value]):
    """Parameters by name; an integer one holds integers only, a float one floats only.

    Starts with `ACTING` and whatever ``more`` names, which wins over it.
    """

    def __init__(self, more: Mapping[str, Value] | None = None) -> None:
        self._values: dict[str, Value] = {**ACTING, **(more or {})}
        self.version = 0
        """Counts the changes, so that who keeps values can tell."""

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def set(self, name: str, value: Value) -> None:
        """Change a known parameter; raises `KeyError` for another and `TypeError` for the wrong type."""
        kind = type(self._values[name])
        if type(value) is not kind:
            raise TypeError(f"{name} is {kind.__name__}, not {type(value).__name__}")
        self._values[name] = value
        self.version += 1

    def add(self, values: Mapping[str, Value]) -> None:
        """Make more parameters known; one that is known already keeps its value."""
        self._values = {**values, **self._values}
