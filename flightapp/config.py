"""The whole tunable surface: every field with its unit, its bounds and a one-line description.

A configuration is built from defaults ← vehicle file ← mission ← ``--set``, and is checked whole; what is
wrong is named by source, key, value, bound and nearest known key.
"""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomlkit
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from flightapp.frames import GRAVITY, camera_mount
from flightapp.inputs import BadInputError, Location, read_toml, validate
from flightapp.perception.camera import CameraModel, Lens
from flightapp.sensors.address import parse_address

Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Quadruple = tuple[Finite, Finite, Finite, Finite]


class Section(BaseModel):
    """A table of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


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
    """The gate camera: calibration, mount and rate."""

    lens: Lens = Field(Lens.PINHOLE, description="pinhole (Brown) or fisheye (Kannala-Brandt)")
    width: int = Field(640, ge=64, le=4096, description="px")
    height: int = Field(480, ge=64, le=4096, description="px")
    focal: Quadruple = Field((320.0, 320.0, 319.5, 239.5), description="px: fx, fy, cx, cy")
    distortion: Quadruple = Field((0.0, 0.0, 0.0, 0.0), description="k1, k2, p1, p2 or fisheye k1..k4")
    rate: Finite = Field(30.0, ge=1.0, le=240.0, description="Hz")
    exposure: Finite = Field(0.004, gt=0.0, le=0.05, description="s")
    latency: Finite = Field(0.015, ge=0.0, le=0.3, description="s, from mid exposure to the frame's arrival")
    pitch_up_deg: Finite = Field(10.0, ge=-45.0, le=60.0, description="°, tilt of the camera above body x")
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
            camera_mount(math.radians(self.pitch_up_deg)),
            np.array(self.position),
        )


class Detection(Section):
    """Finding markers and gates in images."""

    detector: str = Field("aruco", description="entry point in flightapp.detectors")
    region_of_interest: bool = Field(True, description="search only where the map expects markers")
    full_frame_every: int = Field(10, ge=1, le=1000, description="frames between searches of the whole image")
    corner_noise: Finite = Field(0.5, gt=0.01, le=10.0, description="px, standard deviation of a corner")
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
    yaw_walk: Finite = Field(0.005, ge=0.0, le=0.2, description="rad/√m, walk of the tracker's heading with the way")
    yaw_at_rest: Finite = Field(0.0005, gt=0.0, le=0.2, description="rad/√s, the same with time")
    slip_across: Finite = Field(0.002, ge=0.0, le=0.5, description="its horizontal velocity error, share of the speed")
    slip_up: Finite = Field(0.04, ge=0.0, le=1.0, description="s/m, its vertical velocity error per squared speed")
    slip_time: Finite = Field(0.3, gt=0.01, le=100.0, description="s, time constant with which these errors change")
    tilt_error: Finite = Field(0.005, gt=0.0, le=0.2, description="rad, the tracker's error of roll and pitch")
    tilt_time: Finite = Field(5.0, gt=0.1, le=1000.0, description="s, time constant with which that changes")
    accelerometer_noise: Finite = Field(0.1, gt=0.0, le=10.0, description="m/s²/√Hz, vibration included")
    accelerometer_bias: Finite = Field(0.15, gt=0.0, le=5.0, description="m/s², at the start")
    accelerometer_walk: Finite = Field(0.005, ge=0.0, le=1.0, description="m/s²/√s, by which the bias walks")
    manoeuvre: Finite = Field(5.0, gt=0.1, le=100.0, description="m/s²/√Hz, accelerations where nothing feels them")
    coast: Finite = Field(0.5, ge=0.0, le=5.0, description="s without poses for which the inertial sensors stand in")
    trusted_sigma: Finite = Field(1.0, gt=0.01, le=100.0, description="m, a position known worse is not trusted")


class GateMapping(Section):
    """Gate map."""

    attitude_error: Finite = Field(0.004, ge=0.0, le=0.2, description="rad, of tracker and camera mount together")
    range_error: Finite = Field(0.004, ge=0.0, le=0.2, description="share of the distance, camera calibration")
    sync_error: Finite = Field(0.001, ge=0.0, le=0.1, description="s, between the stamps of camera and tracker")
    correlation_time: Finite = Field(0.3, ge=0.0, le=10.0, description="s during which these errors stay the same")
    moved_after: int = Field(15, ge=2, le=1000, description="refused sightings in a row that make a gate a moved one")
    gate: Finite = Field(16.0, gt=1.0, le=100.0, description="χ² (4 dof) beyond which a sighting is refused")
    gate_walk: Finite = Field(0.0, ge=0.0, le=1.0, description="m/√s, by which gates wander")
    known_sigma: Finite = Field(0.35, gt=0.01, le=5.0, description="m, a gate this well known may be flown through")


class Planning(Section):
    """Trajectories."""

    planner: str = Field("race", description="entry point in flightapp.planners")
    minimise: Literal["acceleration", "jerk", "snap"] = Field("jerk", description="derivative to keep small")
    lead: Finite = Field(0.12, ge=0.0, le=1.0, description="s, a new plan starts this long after it is asked for")
    replan_distance: Finite = Field(0.05, gt=0.0, le=2.0, description="m, a gate that moved this far is planned anew")
    replan_interval: Finite = Field(0.15, ge=0.0, le=5.0, description="s, least time between plans")
    horizon: int = Field(8, ge=2, le=100, description="gates ahead that are planned; the others follow as these pass")
    crossing_deg: Finite = Field(25.0, ge=5.0, le=60.0, description="°, angle to a gate's normal to stay within")
    thrust_share: Finite = Field(0.9, gt=0.1, le=1.0, description="of the vehicle's full thrust that plans may use")
    rate_share: Finite = Field(0.6, gt=0.1, le=1.0, description="of vehicle.rate_max that plans may use")
    clearance: Finite = Field(
        0.3, ge=0.0, le=10.0, description="m beyond vehicle.radius that plans keep from obstacles"
    )
    frame_clearance: Finite = Field(0.05, ge=0.0, le=2.0, description="m beyond vehicle.radius, from gates' frames")
    gate_margin: Finite = Field(
        0.15, ge=0.0, le=5.0, description="m from a gate's centre that race lines may use at most"
    )
    waypoint_radius: Finite = Field(0.0, ge=0.0, le=5.0, description="m from waypoints within which race lines pass")
    drag_share: Finite = Field(0.0, ge=0.0, le=1.0, description="of vehicle.drag that race lines count as thrust")
    tilt_max_deg: Finite = Field(60.0, gt=5.0, le=180.0, description="°, greatest tilt of race lines; 180 for any")
    yaw: Literal["gates", "path", "fixed"] = Field(
        "gates", description="look at the next gate, along the path, or hold"
    )
    yaw_acceleration: Finite = Field(10.0, gt=0.1, le=100.0, description="rad/s², greatest of the planned heading")
    screen: bool = Field(True, description="fly each plan in a forward simulation before it is accepted")
    screen_error: Finite = Field(0.4, gt=0.01, le=5.0, description="m off the line in it that make a plan infeasible")
    pace_min: Finite = Field(0.6, gt=0.1, le=1.0, description="least share of the planned speed; 1 never slows down")
    pace_sigmas: Finite = Field(2.0, gt=0.0, le=10.0, description="standard deviations of a gate its opening must hold")
    pace_ahead: Finite = Field(2.0, gt=0.0, le=20.0, description="s before a gate from which its uncertainty counts")


class Control(Section):
    """Trajectory tracking."""

    controller: str = Field("flatness", description="entry point in flightapp.controllers")
    rate: Finite = Field(250.0, ge=20.0, le=1000.0, description="Hz")
    position_bandwidth: Finite = Field(4.0, gt=0.1, le=20.0, description="rad/s, horizontal position loop")
    position_damping: Finite = Field(0.9, gt=0.1, le=3.0, description="damping ratio, horizontal position loop")
    height_bandwidth: Finite = Field(4.5, gt=0.1, le=20.0, description="rad/s, vertical position loop")
    height_damping: Finite = Field(0.9, gt=0.1, le=3.0, description="damping ratio, vertical position loop")
    integral: Finite = Field(0.5, ge=0.0, le=5.0, description="1/s, rate at which a steady error is removed")
    attitude_bandwidth: Finite = Field(8.0, gt=0.5, le=40.0, description="1/s, tilt loop")
    yaw_bandwidth: Finite = Field(3.0, gt=0.1, le=20.0, description="1/s, heading loop")
    tilt_max_deg: Finite = Field(65.0, gt=5.0, le=170.0, description="°, greatest tilt commanded")
    error_max: Finite = Field(1.0, gt=0.05, le=20.0, description="m, position errors count no more than this")
    push_max: Finite = Field(2.0, ge=0.0, le=10.0, description="m/s², greatest steady horizontal push learnt (wind)")
    trim_max: Finite = Field(0.25, ge=0.0, le=0.5, description="greatest relative thrust error learnt (mass, battery)")
    airborne_height: Finite = Field(
        0.25, ge=-100.0, le=100.0, description="m, world height from which these are learnt"
    )


class Race(Section):
    """How to race."""

    v_max: Finite = Field(4.0, gt=0.0, le=40.0, description="m/s, greatest speed planned")
    a_max: Finite = Field(8.0, gt=0.0, le=60.0, description="m/s², greatest acceleration planned")
    standoff: Finite = Field(4.0, ge=0.5, le=20.0, description="m before a gate not yet seen, where to wait for it")
    search_timeout: Finite = Field(20.0, gt=1.0, le=600.0, description="s, longest search for one gate")
    search_yaw_deg: Finite = Field(60.0, ge=0.0, le=180.0, description="°, half-width of the first scan for a gate")
    search_speed: Finite = Field(2.0, gt=0.1, le=10.0, description="m/s, greatest speed between the places of a search")
    search_step: Finite = Field(5.0, ge=1.0, le=20.0, description="m between the places from which a gate is sought")
    attempts: int = Field(3, ge=1, le=20, description="times that one gate is flown at before it counts as missed")
    timeout: Finite = Field(300.0, gt=1.0, le=3600.0, description="s, longest race")


class Mission(Section):
    """Heights, patience and geofence of a mission."""

    takeoff_height: Finite = Field(1.5, ge=0.3, le=20.0, description="m above the ground")
    takeoff_timeout: Finite = Field(40.0, gt=1.0, le=120.0, description="s, the autopilot getting ready included")
    land_timeout: Finite = Field(30.0, gt=1.0, le=300.0, description="s")
    laps: int = Field(1, ge=1, le=1000, description="laps to fly")
    gates_known: bool = Field(True, description="use the track's places of gates; false: only their ids and markers")
    map: str = Field("", description="the map.toml of an earlier flight, whose places of gates are used")
    geofence: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = Field(
        (-100.0, -100.0, -1.0, 100.0, 100.0, 30.0),
        description="m, world: least x, y, z and greatest x, y, z of the box within which gates are searched for",
    )

    @field_validator("geofence")
    @classmethod
    def _box(cls, fence: tuple[float, ...]) -> tuple[float, ...]:
        if any(high - low < 1.0 for low, high in zip(fence[:3], fence[3:], strict=True)):
            raise ValueError("the geofence must be at least 1 m wide along each axis: least x, y, z, greatest x, y, z")
        return fence


class Safety(Section):
    """When to stop trusting."""

    state_timeout: Finite = Field(0.25, gt=0.01, le=5.0, description="s without a state before landing")
    tracking_error: Finite = Field(2.0, gt=0.1, le=20.0, description="m off the line before landing")


class Guard(Section):
    """Bounds on what reaches the autopilot."""

    thrust_min: Finite = Field(1.0, ge=0.0, le=9.0, description="m/s², least specific force sent in flight")
    late: Finite = Field(0.1, gt=0.0, le=1.0, description="s, a command older than this is not sent")
    hold: Finite = Field(0.15, ge=0.0, le=1.0, description="s without a sound command before the autopilot shall land")
    rate_slew: Finite = Field(500.0, gt=1.0, le=1e5, description="rad/s², fastest change of a body rate sent")
    thrust_slew: Finite = Field(1500.0, gt=1.0, le=1e6, description="m/s³, fastest change of the thrust sent")


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


class Realtime(Section):
    """What is asked of the operating system for a flight on the wall clock."""

    priority: int = Field(50, ge=0, le=98, description="SCHED_FIFO of the event loop; 0 leaves the scheduler alone")
    lock_memory: bool = Field(True, description="keep all memory resident (mlockall)")
    cpus: tuple[int, ...] = Field((), description="CPUs for the process; none leaves them alone")


class Compute(Section):
    """Seconds that computation costs in simulation, where it would take none of the virtual time."""

    detection: Finite = Field(0.015, ge=0.0, le=2.0, description="s per frame (paper's laptop: 0.015, Jetson: 0.094)")
    plan: Finite = Field(0.002, ge=0.0, le=5.0, description="s per plan (paper: 0.014 to 1.0)")


class Recording(Section):
    """Flight log."""

    images: bool = Field(True, description="record camera images (JPEG)")
    image_every: int = Field(10, ge=1, le=1000, description="record one frame in so many")


class Simulation(Section):
    """The simulated world; flight code does not read this section."""

    vehicle: str = Field("racer", description="a vehicle of sim/vehicles.toml")
    camera: Literal["rendered", "corners"] = Field("rendered", description="images, or corners without images")
    survey: Literal["rough", "exact"] = Field("rough", description="gates off as the track's uncertainty says, or not")
    tracker: Literal["t265", "ideal"] = Field("t265", description="T265 model, or the truth with no delay")
    wind: Finite = Field(0.0, ge=0.0, le=15.0, description="m/s, mean wind")
    gust: Finite = Field(0.0, ge=0.0, le=5.0, description="m/s, standard deviation of gusts")
    step: Finite = Field(0.001, gt=0.0, le=0.001, description="s, integration step")
    faults: tuple[tuple[Finite, str, Finite | str], ...] = Field(
        (),
        description="(s of the flight's clock, fault, value): sim/sensor_faults.py, or sim/mavlink/faults.py over MAVLink",
    )


class Config(Section):
    """Everything that can be set."""

    vehicle: Vehicle = Vehicle()
    camera: Camera = Camera()
    detection: Detection = Detection()
    estimation: Estimation = Estimation()
    mapping: GateMapping = GateMapping()
    planning: Planning = Planning()
    control: Control = Control()
    race: Race = Race()
    mission: Mission = Mission()
    safety: Safety = Safety()
    guard: Guard = Guard()
    link: Link = Link()
    external_vision: ExternalVision = ExternalVision()
    sensors: Sensors = Sensors()
    realtime: Realtime = Realtime()
    compute: Compute = Compute()
    recording: Recording = Recording()
    sim: Simulation = Simulation()

    @model_validator(mode="after")
    def _flyable(self) -> "Config":
        available = self.vehicle.thrust_max
        needed = math.hypot(GRAVITY, self.race.a_max)
        if needed > available:
            fits = math.sqrt(max(available**2 - GRAVITY**2, 0.0))
            raise ValueError(
                f"race.a_max = {self.race.a_max} m/s² needs {needed:.1f} m/s² of thrust in level flight, but"
                f" vehicle.thrust_to_weight = {self.vehicle.thrust_to_weight} gives {available:.1f};"
                f" race.a_max may be at most {fits:.1f}"
            )
        slowest = min(self.vehicle.drag[0], self.vehicle.drag[1])
        if slowest > 0.0:
            tilt = math.radians(self.control.tilt_max_deg)
            push = min(GRAVITY * math.tan(min(tilt, 1.5)), math.sqrt(available**2 - GRAVITY**2))
            reachable = push / slowest
            if self.race.v_max > reachable:
                raise ValueError(
                    f"race.v_max = {self.race.v_max} m/s cannot be flown: with vehicle.drag = {slowest} 1/s the"
                    f" thrust balances the drag at {reachable:.1f} m/s; race.v_max may be at most that"
                )
        return self


def load_config(
    vehicle_file: Path | None = None,
    mission: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> Config:
    """Defaults ← ``vehicle_file`` ← the mission's dotted settings ← ``--set`` strings "section.key=value"."""
    layers: list[tuple[str, dict[str, Any]]] = []
    if vehicle_file is not None:
        layers.append((str(vehicle_file), read_toml(vehicle_file, "vehicle file")))
    if mission:
        layers.append(("mission", _nested(mission.items(), "mission")))
    for text in overrides:
        key, separator, value = text.partition("=")
        if not separator:
            raise BadInputError(f"--set {text}: expected section.key=value")
        layers.append((f"--set {text}", _nested([(key.strip(), _parse_value(value.strip()))], f"--set {text}")))
    data: dict[str, Any] = {}
    origin: dict[Location, str] = {}
    for source, layer in layers:
        for section, table in layer.items():
            if not isinstance(data.get(section, {}), dict):
                continue  # what an earlier source got wrong stays, to be told
            origin[section,] = source
            if not isinstance(table, dict):
                data[section] = table
                continue
            merged = data.setdefault(section, {})
            for key, value in table.items():
                merged[key] = value
                origin[section, key] = source
    everything = ", ".join(source for source, _ in layers) or "defaults"
    return validate(Config, data, lambda at: origin.get(at[:2], origin.get(at[:1], everything)))


def dump_config(config: Config) -> str:
    """``config`` as TOML, complete, with each field's description as a comment."""
    document = tomlkit.document()
    for name in Config.model_fields:
        section: Section = getattr(config, name)
        table = tomlkit.table()
        for key, sub_field in type(section).model_fields.items():
            value = getattr(section, key)
            item = tomlkit.item(list(value) if isinstance(value, tuple) else value)
            item.comment(sub_field.description or "")
            table.add(key, item)
        document.add(name, table)
    return tomlkit.dumps(document)


def _nested(settings: Iterable[tuple[str, Any]], source: str) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for key, value in settings:
        section, separator, name = key.partition(".")
        if not separator or not section or not name:
            sections = ", ".join(Config.model_fields)
            raise BadInputError(f"{source}: '{key}': expected section.key, with one of the sections {sections}")
        data.setdefault(section, {})[name] = value
    return data


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
