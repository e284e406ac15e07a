"""How to fly: plans, control, the race, and what reaches the autopilot."""

from typing import ClassVar, Literal

from pydantic import Field

from flightapp.config.fields import Finite, Section


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
    frame_clearance: Finite = Field(0.15, ge=0.0, le=2.0, description="m beyond vehicle.radius, from gates' frames")
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
    pace_sigmas: Finite = Field(
        2.0,
        gt=0.0,
        le=10.0,
        description="standard deviations of a gate that its opening must hold, and that plans keep from outside it",
    )
    pace_ahead: Finite = Field(2.0, gt=0.0, le=20.0, description="s before a gate from which its uncertainty counts")


Term = Literal[
    "acceleration",
    "jerk",
    "snap",
    "drag",
    "prediction",
    "rate_lead",
    "thrust_lead",
    "error_rate",
    "disturbance",
    "drift",
]


class Control(Section):
    """Trajectory tracking; gains and bounds may change in flight."""

    # Without its prediction a controller dates commands otherwise, so the history would not fit.
    FIXED_IN_FLIGHT: ClassVar[frozenset[str] | None] = frozenset({"controller", "rate", "without"})

    controller: str = Field("flatness", description="entry point in flightapp.controllers")
    rate: Finite = Field(250.0, ge=20.0, le=1000.0, description="Hz")
    position_bandwidth: Finite = Field(5.0, gt=0.1, le=20.0, description="rad/s, horizontal position loop")
    position_damping: Finite = Field(0.9, gt=0.1, le=3.0, description="damping ratio, horizontal position loop")
    height_bandwidth: Finite = Field(5.5, gt=0.1, le=20.0, description="rad/s, vertical position loop")
    height_damping: Finite = Field(0.9, gt=0.1, le=3.0, description="damping ratio, vertical position loop")
    disturbance_bandwidth: Finite = Field(
        8.0, ge=0.0, le=20.0, description="rad/s, observer of the force that the model does not explain; 0: none"
    )
    drift_bandwidth: Finite = Field(
        4.0, ge=0.0, le=10.0, description="rad/s, observer of a velocity that does not fit the positions; 0: none"
    )
    trim_rate: Finite = Field(
        0.5, ge=0.0, le=5.0, description="1/s, at which what lasts of it is put down to thrust and drag"
    )
    attitude_bandwidth: Finite = Field(8.0, gt=0.5, le=40.0, description="1/s, tilt loop")
    yaw_bandwidth: Finite = Field(3.0, gt=0.1, le=20.0, description="1/s, heading loop")
    tilt_max_deg: Finite = Field(65.0, gt=5.0, le=170.0, description="°, greatest tilt commanded")
    error_max: Finite = Field(1.0, gt=0.05, le=20.0, description="m, position errors count no more than this")
    drag_trim_max: Finite = Field(0.9, ge=0.0, le=0.9, description="greatest relative drag error learnt")
    push_max: Finite = Field(4.0, ge=0.0, le=10.0, description="m/s², greatest disturbance learnt (wind, drag)")
    trim_max: Finite = Field(0.25, ge=0.0, le=0.5, description="greatest relative thrust error learnt (mass, battery)")
    airborne_height: Finite = Field(
        0.25, ge=-100.0, le=100.0, description="m, world height from which these are learnt"
    )
    without: tuple[Term, ...] = Field((), description="terms of the control law that are left out, to see their worth")


class Mpc(Section):
    """Model-predictive tracking; what it weighs follows from the bandwidths and dampings of `control`."""

    horizon: Finite = Field(0.6, ge=0.2, le=2.0, description="s that are planned ahead, in 20 steps")
    iterations: int = Field(1, ge=1, le=5, description="improvements of the plan at each tick")


class Mpcc(Mpc):
    """Contouring: the line's own time goes on faster or slower, as far as that keeps the vehicle on the line."""

    rate_min: Finite = Field(0.7, gt=0.0, le=1.0, description="s of the line per s of flight, least")
    rate_max: Finite = Field(1.2, ge=1.0, le=2.0, description="the same, greatest; never above the line's top speed")
    ahead: Finite = Field(0.3, ge=0.0, le=5.0, description="s by which the line's time may run ahead")
    behind: Finite = Field(1.0, ge=0.0, le=5.0, description="s by which it may fall behind")
    worth: Finite = Field(1.0, gt=0.0, le=5.0, description="m off the line that count as much as no progress at all")
    progress_bandwidth: Finite = Field(6.0, gt=0.1, le=50.0, description="rad/s, at which the line's rate changes")
    stiffness: Finite = Field(1.4, gt=0.2, le=3.0, description="share of control's position bandwidths between gates")
    gate_stiffness: Finite = Field(1.7, gt=0.2, le=3.0, description="share of them in a gate")
    gate_zone: Finite = Field(1.5, gt=0.05, le=20.0, description="m from a gate within which the latter counts")


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
    """Heights and patience of a mission."""

    takeoff_height: Finite = Field(1.5, ge=0.3, le=20.0, description="m above the ground")
    takeoff_timeout: Finite = Field(40.0, gt=1.0, le=120.0, description="s, the autopilot getting ready included")
    land_timeout: Finite = Field(30.0, gt=1.0, le=300.0, description="s")
    laps: int = Field(1, ge=1, le=1000, description="laps to fly")
    gates_known: bool = Field(True, description="use the track's places of gates; false: only their ids and markers")
    parameters: dict[str, bool | int | Finite | str] = Field(
        default_factory=dict, description="what the mission itself can be told: its PARAMETERS, by name"
    )
    map: str = Field("", description="the map.toml of an earlier flight, whose places of gates are used")


class Guard(Section):
    """Bounds on what reaches the autopilot."""

    thrust_min: Finite = Field(1.0, ge=0.0, le=9.0, description="m/s², least specific force sent in flight")
    late: Finite = Field(0.1, gt=0.0, le=1.0, description="s, a command older than this is not sent")
    hold: Finite = Field(0.15, ge=0.0, le=1.0, description="s without a sound command before the autopilot shall land")
    stall: Finite = Field(
        0.45, gt=0.0, le=1.0, description="s without the sender after which the autopilot has left OFFBOARD and lands"
    )
    rate_slew: Finite = Field(500.0, gt=1.0, le=1e5, description="rad/s², fastest change of a body rate sent")
    thrust_slew: Finite = Field(1500.0, gt=1.0, le=1e6, description="m/s³, fastest change of the thrust sent")
