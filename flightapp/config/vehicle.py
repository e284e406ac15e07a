"""The vehicle and its camera."""

import math
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from flightapp.config.fields import Finite, Quadruple, Section, Triple
from flightapp.frames import GRAVITY, camera_mount
from flightapp.perception.camera import CameraModel, Lens


class Vehicle(Section):
    """The airframe as the flight code knows it."""

    name: str = Field("racer", description="name, for reports")
    thrust_to_weight: Finite = Field(3.1, gt=1.1, le=20.0, description="full collective thrust over weight")
    hover_thrust: Finite = Field(0.25, gt=0.02, lt=0.9, description="0..1, PX4's MPC_THR_HOVER")
    thrust_curve: Finite = Field(0.0, ge=0.0, le=1.0, description="left of the motors' curve after PX4's THR_MDL_FAC")
    battery_scale: bool = Field(False, description="scale thrust by the battery's voltage; not with MC_BAT_SCALE_EN")
    hover_voltage: Finite = Field(16.0, gt=2.0, le=70.0, description="V under load, where hover_thrust was measured")
    learn_hover_thrust: bool = Field(True, description="correct hover_thrust in flight, by up to 30 %")
    drag: Triple = Field((0.355, 0.38, 0.555), description="1/s, specific force per m/s along the body axes")
    rate_lag: Finite = Field(0.036, ge=0.0, le=0.5, description="s, first-order lag of the roll and pitch rates")
    yaw_rate_lag: Finite = Field(0.09, ge=0.0, le=1.0, description="s, first-order lag of the yaw rate")
    motor_lag: Finite = Field(0.008, ge=0.0, le=0.5, description="s, first-order lag of the thrust, beyond the delay")
    delay: Finite = Field(0.029, ge=0.0, le=0.2, description="s, from a command's being sent to its taking effect")
    rate_max: Finite = Field(6.0, gt=0.5, le=30.0, description="rad/s, greatest roll and pitch rate commanded")
    yaw_rate_max: Finite = Field(3.0, gt=0.2, le=15.0, description="rad/s, greatest yaw rate commanded")
    radius: Finite = Field(0.2, gt=0.02, le=2.0, description="m, of the smallest ball around the vehicle")
    mass: Finite = Field(0.8, gt=0.01, le=50.0, description="kg, for single rotors as inertia, rotor and torque_ratio")
    inertia: Triple = Field((0.0025, 0.0021, 0.0043), description="kg m² about the body axes")
    rotor: tuple[Finite, Finite] = Field((0.075, 0.1), description="m, rotors ahead of and beside the centre of mass")
    torque_ratio: Finite = Field(0.022, gt=0.0, le=0.5, description="m, a rotor's reaction torque over its thrust")

    @property
    def thrust_max(self) -> float:
        """Full collective specific force, m/s²."""
        return self.thrust_to_weight * GRAVITY


class Camera(Section):
    """The gate camera: where its images come from, calibration, mount and rate."""

    source: str = Field(
        "",
        description="of a real vehicle's images: /dev/videoN, csi:N, a URL, or a recording (directory, video, .mcap);"
        " empty: none",
    )
    lens: Lens = Field(Lens.PINHOLE, description="pinhole (Brown) or fisheye (Kannala-Brandt)")
    width: int = Field(640, ge=64, le=4096, description="px")
    height: int = Field(480, ge=64, le=4096, description="px")
    focal: Quadruple = Field((320.0, 320.0, 319.5, 239.5), description="px: fx, fy, cx, cy")
    distortion: Quadruple = Field((0.0, 0.0, 0.0, 0.0), description="k1, k2, p1, p2 or fisheye k1..k4")
    rate: Finite = Field(30.0, ge=1.0, le=240.0, description="Hz")
    format: Literal["any", "MJPG", "YUYV", "GREY"] = Field("any", description="of a /dev/videoN's images")
    exposure: Finite = Field(0.004, gt=0.0, le=0.05, description="s")
    auto_exposure: bool = Field(False, description="let the camera choose the exposure: it blurs in poor light")
    gain: Finite = Field(-1.0, ge=-1.0, le=1e5, description="in the driver's units; -1 leaves it alone")
    latency: Finite = Field(0.015, ge=0.0, le=0.3, description="s, from mid exposure to the frame's arrival")
    stamps: Literal["auto", "driver", "arrival"] = Field(
        "auto", description="driver: V4L2's, less driver_delay; arrival: less latency; auto: the driver's if they are"
    )
    driver_delay: Finite = Field(0.0, ge=-0.1, le=0.3, description="s, from mid exposure to the driver's stamp")
    pitch_up_deg: Finite = Field(10.0, ge=-90.0, le=90.0, description="°, tilt of the camera above body x")
    roll_deg: Finite = Field(0.0, ge=-180.0, le=180.0, description="°, about body x, before pitch and yaw")
    yaw_deg: Finite = Field(0.0, ge=-180.0, le=180.0, description="°, to the left of body x")
    position: Triple = Field((0.08, 0.0, 0.02), description="m, in the body frame")

    @model_validator(mode="after")
    def _sharp(self) -> "Camera":
        if self.focal[0] <= 0.0 or self.focal[1] <= 0.0:
            raise ValueError(f"focal lengths must be positive, not {self.focal[:2]} px")
        return self

    def model(self) -> CameraModel:
        """The camera model that these numbers describe."""
        return CameraModel(
            self.lens,
            self.width,
            self.height,
            np.array(self.focal),
            np.array(self.distortion),
            camera_mount(*(math.radians(angle) for angle in (self.pitch_up_deg, self.roll_deg, self.yaw_deg))),
            np.array(self.position),
        )
