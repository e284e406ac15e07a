"""When to stop trusting, and where the vehicle may be."""

import itertools

from pydantic import Field, field_validator, model_validator

from flightapp.config.fields import Finite, Section

Corner = tuple[Finite, Finite]
LEAST = 1.0
"""m, least extent of a geofence along each axis."""


class Safety(Section):
    """When a fault is one; what is done then stands in docs/faults.md."""

    pose_timeout: Finite = Field(0.25, gt=0.01, le=5.0, description="s without a pose before it stops and waits")
    state_timeout: Finite = Field(0.25, gt=0.01, le=5.0, description="s without a state before landing")
    tracking_error: Finite = Field(2.0, gt=0.1, le=20.0, description="m off the line before landing")
    doubt_time: Finite = Field(0.1, ge=0.0, le=5.0, description="s of doubt before the state is not trusted any more")
    camera_timeout: Finite = Field(1.0, gt=0.05, le=60.0, description="s without a new image: the camera is lost")
    plan_failures: int = Field(5, ge=1, le=1000, description="plans in a row refused while standing: planner failing")
    tilt_margin_deg: Finite = Field(25.0, ge=0.0, le=120.0, description="° of tilt beyond the greatest commanded")
    speed_margin: Finite = Field(3.0, gt=0.0, le=40.0, description="m/s beyond race.v_max")
    tipped_deg: Finite = Field(70.0, gt=20.0, le=180.0, description="° of tilt near the ground: it lies on its side")
    battery_low: Finite = Field(0.2, ge=0.0, le=1.0, description="charge, 0..1, below which to be slow, or not to arm")
    battery_critical: Finite = Field(0.1, ge=0.0, le=1.0, description="charge below which to land")
    overload_share: Finite = Field(0.2, gt=0.0, le=1.0, description="of a second's control ticks that may be missed")
    overload_lag: Finite = Field(0.4, gt=0.01, le=10.0, description="s by which detection may be behind the camera")
    disk_free: Finite = Field(200.0, ge=0.0, le=1e7, description="MB that must be free where the log is written")
    clock_jump: Finite = Field(0.5, gt=0.0, le=3600.0, description="s by which the wall clock may jump unnoticed")
    hold_time: Finite = Field(10.0, ge=0.0, le=600.0, description="s of hovering for a fault to pass before landing")

    @model_validator(mode="after")
    def _ordered(self) -> "Safety":
        if self.battery_critical > self.battery_low:
            raise ValueError(
                f"battery_critical = {self.battery_critical} must not be more than battery_low = {self.battery_low}"
            )
        return self


class Geofence(Section):
    """A vertical prism that no plan leaves, and that gates are searched for in."""

    corners: tuple[Corner, ...] = Field(
        ((-100.0, -100.0), (100.0, 100.0)),
        description="m, world: (x, y) of two opposite corners of a box, or of all corners of a polygon in order",
    )
    floor: Finite = Field(-1.0, description="m, world: least z")
    ceiling: Finite = Field(30.0, description="m, world: greatest z")
    margin: Finite = Field(0.5, ge=0.0, le=20.0, description="m outside that the vehicle may be before it lands")

    @field_validator("corners")
    @classmethod
    def _simple(cls, corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
        if len(corners) < 2:
            raise ValueError("a geofence needs two opposite corners of a box, or the corners of a polygon")
        around = outline(corners)
        for axis in range(2):
            if max(c[axis] for c in around) - min(c[axis] for c in around) < LEAST:
                raise ValueError(f"the geofence must be at least {LEAST:g} m wide along each axis")
        if _crosses_itself(around):
            raise ValueError("the geofence's outline crosses or touches itself: give its corners in order")
        return corners

    @model_validator(mode="after")
    def _high(self) -> "Geofence":
        if self.ceiling - self.floor < LEAST:
            raise ValueError(f"the ceiling must be at least {LEAST:g} m above the floor")
        return self


def outline(corners: tuple[Corner, ...]) -> tuple[Corner, ...]:
    """All corners in order round the outline; two of them stand for a box."""
    if len(corners) != 2:
        return corners
    (x0, y0), (x1, y1) = corners
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def _crosses_itself(around: tuple[Corner, ...]) -> bool:
    """Whether two edges that are no neighbours meet, or a corner is there twice."""
    edges = list(zip(around, around[1:] + around[:1], strict=True))
    if any(a == b for a, b in edges):
        return True
    count = len(edges)
    for i, k in itertools.combinations(range(count), 2):
        if k - i in (1, count - 1):
            continue
        (a, b), (c, d) = edges[i], edges[k]
        if _side(a, b, c) * _side(a, b, d) <= 0.0 and _side(c, d, a) * _side(c, d, b) <= 0.0:
            return True
    return False


def _side(a: Corner, b: Corner, c: Corner) -> float:
    """Positive where ``c`` lies to the left of the way from ``a`` to ``b``."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
