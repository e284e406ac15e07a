"""The link to the autopilot, the computer, the log, and the simulated world."""

from typing import Literal

from pydantic import Field, field_validator

from flightapp.config.fields import Finite, Section
from flightapp.sensors.address import parse_address


class Link(Section):
    """The MAVLink link to the autopilot."""

    connection: str = Field("udpin://127.0.0.1:14540", description="udpin://HOST:PORT or serial:///dev/NAME:BAUD")
    system_id: int = Field(1, ge=1, le=254, description="MAVLink system id of the vehicle to fly, MAV_SYS_ID")
    connect_timeout: Finite = Field(15.0, gt=0.5, le=600.0, description="s to wait for the autopilot")
    lost_after: Finite = Field(1.0, gt=0.1, le=10.0, description="s without any message before the link counts as lost")
    odometry_rate: Finite = Field(20.0, ge=1.0, le=250.0, description="Hz, of the autopilot's own estimate")
    imu_rate: Finite = Field(200.0, ge=10.0, le=1000.0, description="Hz, of the autopilot's inertial sensors")


class ExternalVision(Section):
    """Poses of the tracker for the autopilot's own estimator."""

    message: Literal["odometry", "odometry_frd", "position"] = Field(
        "odometry", description="ODOMETRY in NED (any PX4), ODOMETRY in FRD (v1.16 only), VISION_POSITION_ESTIMATE"
    )
    rate: Finite = Field(40.0, ge=5.0, le=100.0, description="Hz")
    timesync: bool = Field(False, description="answer TIMESYNC, so that PX4 takes our stamps; else set EKF2_EV_DELAY")
    delay: Finite = Field(0.01, ge=0.0, le=0.3, description="s from a pose's capture to the autopilot, EKF2_EV_DELAY")
    position_noise: Finite = Field(0.02, gt=0.0, le=1.0, description="m, standard deviation told to the autopilot")
    velocity_noise: Finite = Field(0.05, gt=0.0, le=2.0, description="m/s, standard deviation told to the autopilot")
    attitude_noise: Finite = Field(0.02, gt=0.0, le=0.5, description="rad, standard deviation told to the autopilot")
    jump: Finite = Field(0.3, gt=0.0, le=5.0, description="m, beyond what the speed explains, that counts as a reset")


class Realtime(Section):
    """What is asked of the operating system for a flight on the wall clock."""

    priority: int = Field(50, ge=0, le=98, description="SCHED_FIFO of the event loop; 0 leaves the scheduler alone")
    lock_memory: bool = Field(True, description="keep all memory resident (mlockall)")
    cpus: tuple[int, ...] = Field((), description="CPUs for the process; none leaves them alone")


class Compute(Section):
    """Seconds that computation costs in simulation, where it would take none of the virtual time."""

    detection: Finite = Field(0.015, ge=0.0, le=2.0, description="s per frame (paper's laptop: 0.015, Jetson: 0.094)")
    plan: Finite = Field(0.002, ge=0.0, le=5.0, description="s per plan (paper: 0.014 to 1.0)")
    reload: Finite = Field(0.01, ge=0.0, le=2.0, description="s to read the configuration anew in flight")


class Recording(Section):
    """Flight log."""

    images: bool = Field(True, description="record camera images (JPEG)")
    image_every: int = Field(10, ge=1, le=1000, description="record one frame in so many")
    truth_address: str = Field(
        "",
        description="where a motion-capture system's poses of a real vehicle arrive, in the world frame, for the log"
        " alone: 127.0.0.1:PORT or an absolute path; empty: nowhere",
    )

    @field_validator("truth_address")
    @classmethod
    def _local(cls, text: str) -> str:
        if text:
            parse_address(text)
        return text


class Simulation(Section):
    """The simulated world; flight code does not read this section."""

    vehicle: str = Field("racer", description="a vehicle of sim/vehicles.toml")
    camera: Literal["rendered", "corners"] = Field("rendered", description="images, or corners without images")
    survey: Literal["rough", "exact"] = Field("rough", description="gates off as the track's uncertainty says, or not")
    calibration: Finite = Field(
        1.0, ge=0.0, le=10.0, description="the camera differs from its calibration by so many times the usual error"
    )
    tracker: Literal["t265", "ideal"] = Field("t265", description="T265 model, or the truth with no delay")
    wind: Finite = Field(0.0, ge=0.0, le=15.0, description="m/s, mean wind")
    gust: Finite = Field(0.0, ge=0.0, le=5.0, description="m/s, standard deviation of gusts")
    step: Finite = Field(0.001, gt=0.0, le=0.001, description="s, integration step")
    mass_factor: Finite = Field(
        1.0, ge=0.5, le=2.0, description="of the vehicle's mass; its file still knows the old one"
    )
    thrust_factor: Finite = Field(1.0, ge=0.5, le=2.0, description="of its rotors' thrust")
    drag_factor: Finite = Field(1.0, ge=0.0, le=5.0, description="of its drag")
    motor_factor: Finite = Field(1.0, ge=0.1, le=5.0, description="of its motors' time constants")
    delay_extra: Finite = Field(0.0, ge=-0.1, le=0.1, description="s, more delay until a command takes effect")
    mismatch: Finite = Field(
        0.0,
        ge=0.0,
        le=3.0,
        description="draw all of these besides, from the seed; 1: mass and thrust ± 10 %, drag × 0.5 to 2,"
        " motors ± 30 %, delay ± 10 ms",
    )
    faults: tuple[tuple[Finite, str, Finite | str], ...] = Field(
        (),
        description="(s of the flight's clock, fault, value): sim/faults.py; over MAVLink sim/mavlink/faults.py",
    )
