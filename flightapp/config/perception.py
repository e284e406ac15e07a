"""From images and poses to state and map."""

from typing import Literal

from pydantic import Field, field_validator, model_validator

from flightapp.config.fields import Finite, Section, Triple
from flightapp.sensors.address import parse_address


class Detection(Section):
    """Finding markers and gates in images."""

    detector: str = Field("aruco", description="entry point in flightapp.detectors")
    region_of_interest: bool = Field(True, description="search only where the map expects markers")
    full_frame_every: int = Field(10, ge=1, le=1000, description="frames between searches of the whole image")
    corner_noise: Finite = Field(
        0.2,
        gt=0.01,
        le=10.0,
        description="px, standard deviation of a corner, for detectors that do not tell what they expect",
    )
    max_reprojection: Finite = Field(2.5, gt=0.1, le=50.0, description="px RMS, above it a sighting is refused")
    max_distance: Finite = Field(12.0, gt=0.5, le=100.0, description="m, beyond it a sighting is refused")
    region_margin: Finite = Field(20.0, ge=4.0, le=500.0, description="px around a marker that the map expects")
    region_coverage: Finite = Field(0.6, gt=0.0, le=1.0, description="part of the image, above it all is searched")


class Estimation(Section):
    """Vehicle state: what the tracker and the inertial sensors get wrong, as standard deviations."""

    estimator: str = Field("fusion", description="entry point in flightapp.estimators")
    start_position: Finite = Field(0.003, gt=0.0, le=5.0, description="m, of the start in the track's frame")
    start_yaw: Finite = Field(0.002, gt=0.0, le=1.0, description="rad, of the heading there")
    position_noise: Finite = Field(0.003, gt=0.0, le=1.0, description="m, of the tracker from sample to sample")
    velocity_noise: Finite = Field(0.03, gt=0.0, le=2.0, description="m/s, of the tracker from sample to sample")
    scale_error: Finite = Field(0.03, gt=0.0, le=0.3, description="share of the way by which the tracker is off")
    drift_walk: Finite = Field(0.01, ge=0.0, le=1.0, description="m/√m, walk of the tracker's origin with the way")
    drift_at_rest: Finite = Field(0.001, gt=0.0, le=1.0, description="m/√s, the same with time")
    yaw_walk: Finite = Field(0.006, ge=0.0, le=0.2, description="rad/√m, walk of the tracker's heading with the way")
    yaw_at_rest: Finite = Field(0.0005, gt=0.0, le=0.2, description="rad/√s, the same with time")
    slip_across: Finite = Field(0.002, ge=0.0, le=0.5, description="its horizontal velocity error, share of the speed")
    slip_time: Finite = Field(0.3, gt=0.01, le=100.0, description="s, time constant with which that changes")
    slip_up: Finite = Field(0.025, ge=0.0, le=1.0, description="s²/m², its vertical velocity error per cubed speed")
    slip_up_time: Finite = Field(100.0, gt=0.01, le=1e4, description="s, time constant with which that changes")
    slip_fades: Finite = Field(5.0, gt=0.1, le=1e6, description="m flown until the vertical one has faded to 1/e")
    tilt_error: Finite = Field(0.005, gt=0.0, le=0.2, description="rad, the tracker's error of roll and pitch")
    tilt_time: Finite = Field(5.0, gt=0.1, le=1000.0, description="s, time constant with which that changes")
    accelerometer_noise: Finite = Field(0.1, gt=0.0, le=10.0, description="m/s²/√Hz, vibration included")
    accelerometer_bias: Finite = Field(0.15, gt=0.0, le=5.0, description="m/s², at the start")
    accelerometer_walk: Finite = Field(0.005, ge=0.0, le=1.0, description="m/s²/√s, by which the bias walks")
    manoeuvre: Finite = Field(5.0, gt=0.1, le=100.0, description="m/s²/√Hz, accelerations where nothing feels them")
    coast: Finite = Field(0.5, ge=0.0, le=5.0, description="s without poses for which the inertial sensors stand in")
    trusted_sigma: Finite = Field(5.0, gt=0.01, le=100.0, description="m, a position known worse is not trusted")
    trusted_speed: Finite = Field(2.0, gt=0.01, le=100.0, description="m/s, a velocity known worse is not trusted")


class GateMapping(Section):
    """Gate map."""

    attitude_error: Finite = Field(0.004, ge=0.0, le=0.2, description="rad, of the camera's mount on the tracker")
    range_error: Finite = Field(0.004, ge=0.0, le=0.2, description="share of the distance, of the camera's calibration")
    sync_error: Finite = Field(0.001, ge=0.0, le=0.1, description="s, between the stamps of camera and tracker")
    correlation_time: Finite = Field(
        0.1, ge=0.0, le=10.0, description="s, at least, in which errors of the lens stay the same"
    )
    same_view: Finite = Field(
        0.03, ge=0.0, le=1.0, description="rad by which a view must change for other errors of the lens"
    )
    moved_after: int = Field(15, ge=2, le=1000, description="refused sightings in a row that make a gate a moved one")
    gate: Finite = Field(16.0, gt=1.0, le=100.0, description="χ² (4 dof) beyond which a sighting is refused")
    gate_walk: Finite = Field(0.0, ge=0.0, le=1.0, description="m/√s, by which gates wander")
    known_sigma: Finite = Field(0.35, gt=0.01, le=5.0, description="m, a gate this well known may be flown through")


class Sensors(Section):
    """Where a real vehicle's sensors are found; a simulation brings its own."""

    poses: Literal["socket", "realsense", "replay", "autopilot"] = Field(
        "socket",
        description="socket: from another process; realsense: a T265 by pyrealsense2; replay: from a file;"
        " autopilot: its own ODOMETRY, where it finds its way itself",
    )
    pose_address: str = Field(
        "127.0.0.1:5601", description="for datagrams of poses: 127.0.0.1:PORT or an absolute path"
    )
    replay: str = Field("", description="the file for poses = replay: .mcap, .csv or .txt/.tum")
    pose_max_age: Finite = Field(0.2, gt=0.0, le=5.0, description="s from capture, an older pose is refused")
    delay: Finite = Field(
        0.0, ge=-0.5, le=0.5, description="s by which the tracker's stamps are later than the capture"
    )
    mount_position: Triple = Field((0.0, 0.0, 0.0), description="m, the tracker in the body frame (its lever arm)")
    mount_rpy_deg: Triple = Field(
        (0.0, 0.0, 0.0), description="deg, roll, pitch and yaw of the tracker's axes (FLU) in the body frame"
    )
    frame: Literal["tracker", "start"] = Field(
        "tracker",
        description="tracker: its frame as it is (mocap); start: moved so that the track's start is there (T265)",
    )
    max_jump: Finite = Field(0.5, gt=0.0, le=5.0, description="m between poses, beyond what the speed explains")
    max_turn_deg: Finite = Field(
        20.0, gt=0.0, le=180.0, description="deg between poses, beyond what the angular velocity explains"
    )

    @field_validator("pose_address")
    @classmethod
    def _local(cls, text: str) -> str:
        parse_address(text)
        return text

    @model_validator(mode="after")
    def _replayed(self) -> "Sensors":
        if self.poses == "replay" and not self.replay:
            raise ValueError("sensors.poses = 'replay' needs the file: give sensors.replay")
        return self
