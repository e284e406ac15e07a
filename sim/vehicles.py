"""Simulated vehicles: what they are made of, read from ``vehicles.toml``."""

import functools
import math
import tomllib
from importlib import resources
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from flightapp.frames import GRAVITY, Vector
from flightapp.inputs import BadInputError, validate
from sim import layout as at

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
AIR_DENSITY = 1.225
"""kg/m³, International Standard Atmosphere at sea level."""
FOOT_SAG = 0.002
"""m, how far the feet give way under the weight at rest."""
FOOT_DAMPING_RATIO = 0.7


class Battery(BaseModel):
    """A lithium-polymer pack: open-circuit voltage over charge, behind a resistance."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    cells: int = Field(ge=1, le=14)
    rated_voltage: Positive = Field(description="V, at which the motors give thrust_max")
    resistance: NotNegative = Field(description="Ω, whole pack")
    capacity: Positive = Field(description="A h")
    open_circuit: tuple[Positive, ...] = Field(min_length=11, max_length=11, description="V a cell at 0, 10, … 100 %")
    efficiency: Annotated[float, Field(gt=0.0, le=1.0)] = Field(description="shaft power over electric power")
    avionics: NotNegative = Field(description="W, all but the motors")


class RateLoop(BaseModel):
    """PX4's body-rate loop; axes roll, pitch, yaw."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate: Annotated[float, Field(ge=50.0, le=1000.0)] = Field(description="Hz")
    gyro_cutoff: Positive = Field(description="Hz, second-order Butterworth")
    acceleration_cutoff: Positive = Field(description="Hz, first order, of the D term")
    yaw_torque_cutoff: NotNegative = Field(description="Hz, first order; 0: off")
    p: tuple[NotNegative, NotNegative, NotNegative]
    i: tuple[NotNegative, NotNegative, NotNegative]
    d: tuple[NotNegative, NotNegative, NotNegative]
    integral_limit: tuple[NotNegative, NotNegative, NotNegative]
    thrust_curve: Fraction = Field(description="THR_MDL_FAC")


class VehicleParameters(BaseModel):
    """A quadrotor; SI units."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    mass: Positive
    inertia: tuple[Positive, Positive, Positive] = Field(description="kg m², body axes")
    rotor: tuple[Positive, Positive] = Field(description="m, rotors ahead of and beside the centre of mass")
    thrust_max: Positive = Field(description="N, one rotor at the rated voltage")
    thrust_coefficient: Positive = Field(description="N s²/rad²")
    torque_ratio: NotNegative = Field(description="m, reaction torque over thrust")
    motor_up: Positive = Field(description="s, time constant of a rotor that speeds up")
    motor_down: Positive = Field(description="s, of one that slows down")
    motor_curve: Fraction = Field(description="f in thrust/thrust_max = f u² + (1 - f) u")
    linear_drag: tuple[NotNegative, NotNegative, NotNegative] = Field(description="N/(m/s), body axes")
    drag_area: NotNegative = Field(description="m², drag coefficient × area of the body")
    angular_damping: NotNegative = Field(description="N m/(rad/s)")
    radius: Positive = Field(description="m, of the smallest ball around it")
    delay: NotNegative = Field(description="s, from a command's being sent to its reaching the rate loop")
    battery: Battery
    rate_loop: RateLoop

    @property
    def thrust_to_weight(self) -> float:
        """Full collective thrust at the rated voltage over weight."""
        return 4.0 * self.thrust_max / (self.mass * GRAVITY)

    @property
    def hover_thrust(self) -> float:
        """PX4's collective thrust 0..1 that holds a hover at the rated voltage, where PX4 knows the motors' curve."""
        return 1.0 / self.thrust_to_weight

    @property
    def specific_drag(self) -> Vector:
        """(3,) 1/s, linear drag over mass, body axes."""
        return np.array(self.linear_drag) / self.mass

    def constants(self, step: float, start: float, wind: Vector, gust: float) -> Vector:
        """The constants of the compiled vehicle for steps of ``step`` s from time ``start``; see `layout`."""
        P = np.zeros(at.CONSTANTS_SIZE)
        P[at.P_STEP], P[at.P_START], P[at.P_GUST] = step, start, gust
        P[at.P_WIND : at.P_WIND + 3] = wind
        self._pack_body(P, step)
        self._pack_battery(P)
        self._pack_rate_loop(P, max(1.0 / self.rate_loop.rate, step))
        return P

    def _pack_body(self, P: Vector, step: float) -> None:
        P[at.P_MASS_INVERSE] = 1.0 / self.mass
        P[at.P_INERTIA : at.P_INERTIA + 3] = self.inertia
        P[at.P_INERTIA_INVERSE : at.P_INERTIA_INVERSE + 3] = 1.0 / np.array(self.inertia)
        P[at.P_ROTOR_X], P[at.P_ROTOR_Y] = self.rotor
        P[at.P_SPEED_MAX] = math.sqrt(self.thrust_max / self.thrust_coefficient)
        P[at.P_THRUST_COEFFICIENT] = self.thrust_coefficient
        P[at.P_TORQUE_RATIO] = self.torque_ratio
        P[at.P_DECAY_UP] = math.exp(-0.5 * step / self.motor_up)
        P[at.P_DECAY_DOWN] = math.exp(-0.5 * step / self.motor_down)
        P[at.P_MOTOR_CURVE] = self.motor_curve
        P[at.P_LINEAR_DRAG : at.P_LINEAR_DRAG + 3] = self.linear_drag
        P[at.P_QUADRATIC_DRAG] = 0.5 * AIR_DENSITY * self.drag_area
        P[at.P_DAMPING] = self.angular_damping
        P[at.P_STIFFNESS] = self.mass * GRAVITY / 4.0 / FOOT_SAG
        P[at.P_CONTACT_DAMPING] = 2.0 * FOOT_DAMPING_RATIO * math.sqrt(GRAVITY / FOOT_SAG) * self.mass / 4.0

    def _pack_battery(self, P: Vector) -> None:
        battery = self.battery
        P[at.P_RATED_VOLTAGE] = battery.rated_voltage
        P[at.P_RESISTANCE] = battery.resistance
        P[at.P_CAPACITY] = battery.capacity * 3600.0
        P[at.P_EFFICIENCY] = battery.efficiency
        P[at.P_AVIONICS] = battery.avionics
        P[at.P_OPEN_CIRCUIT : at.P_OPEN_CIRCUIT + 11] = battery.cells * np.array(battery.open_circuit)

    def _pack_rate_loop(self, P: Vector, period: float) -> None:
        loop = self.rate_loop
        P[at.P_LOOP_PERIOD], P[at.P_LOOP_RATE] = period, 1.0 / period
        P[at.P_GAIN_P : at.P_GAIN_P + 3] = loop.p
        P[at.P_GAIN_I : at.P_GAIN_I + 3] = loop.i
        P[at.P_GAIN_D : at.P_GAIN_D + 3] = loop.d
        P[at.P_INTEGRAL_LIMIT : at.P_INTEGRAL_LIMIT + 3] = loop.integral_limit
        P[at.P_THRUST_CURVE] = loop.thrust_curve
        P[at.P_GYRO_FILTER : at.P_GYRO_FILTER + 5] = _butterworth(loop.gyro_cutoff, period)
        P[at.P_ACCELERATION_ALPHA] = _smoothing(loop.acceleration_cutoff, period)
        P[at.P_YAW_ALPHA] = _smoothing(loop.yaw_torque_cutoff, period) if loop.yaw_torque_cutoff > 0.0 else 1.0
        # PX4 scales roll and pitch alike, so that the axis with the shorter arm gets ±1/√2.
        shorter = min(self.rotor)
        P[at.P_MIX_ROLL] = math.sqrt(0.5) * shorter / self.rotor[1]
        P[at.P_MIX_PITCH] = math.sqrt(0.5) * shorter / self.rotor[0]


def _butterworth(cutoff: float, period: float) -> tuple[float, float, float, float, float]:
    """b0, b1, b2, a1, a2 of a second-order Butterworth low-pass (bilinear transform); PX4's gyro filter."""
    w = math.tan(math.pi * min(cutoff * period, 0.49))
    c = 1.0 + math.sqrt(2.0) * w + w * w
    b0 = w * w / c
    return b0, 2.0 * b0, b0, 2.0 * (w * w - 1.0) / c, (1.0 - math.sqrt(2.0) * w + w * w) / c


def _smoothing(cutoff: float, period: float) -> float:
    """Weight of a new sample in a first-order low-pass."""
    return period / (period + 1.0 / (2.0 * math.pi * cutoff))


def vehicle_names() -> list[str]:
    """The vehicles that can be flown."""
    return list(_tables())


@functools.cache
def load_vehicle(name: str) -> VehicleParameters:
    """The simulated vehicle ``name``; raises `BadInputError` that names those there are."""
    tables = _tables()
    if name not in tables:
        raise BadInputError(f"sim.vehicle = {name!r}: there is no such vehicle; known: {', '.join(tables)}")
    return validate(VehicleParameters, {"name": name, **tables[name]}, f"sim/vehicles.toml: {name}")


def _tables() -> dict[str, dict[str, object]]:
    text = resources.files("sim").joinpath("vehicles.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
