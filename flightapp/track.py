"""Tracks: gates in the order of passage, start, finish, waypoints and obstacles, from TOML.

Coordinates are metres in the world frame; a gate's yaw is its direction of passage.
"""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from flightapp.frames import Vector
from flightapp.inputs import read_toml, validate

Finite = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Finite, Finite, Finite]
Length = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
FORBID = ConfigDict(extra="forbid", frozen=True)

FRAME_THICKNESS = 0.08
"""m, of a gate's frame along the direction of passage."""


class MarkerLayout(StrEnum):
    """Where a gate carries its markers, on the side that is seen on approach."""

    TOP = "top"
    """One, above the opening."""
    CORNERS = "corners"
    """Four: top left, top right, bottom right, bottom left as seen on approach."""


NAMED_DICTIONARIES = {
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36h12": 250,
    "APRILTAG_16h5": 30,
    "APRILTAG_25h9": 35,
    "APRILTAG_36h10": 2320,
    "APRILTAG_36h11": 587,
}
"""OpenCV's dictionaries whose names don't tell how many markers they have, and how many."""


class GateShape(BaseModel):
    """What all gates of a track have in common."""

    model_config = FORBID

    opening: float = Field(1.4, gt=0.3, le=10.0, description="m, side of the square opening")
    border: float = Field(0.4, gt=0.0, le=2.0, description="m, width of the frame around the opening")
    marker_size: float = Field(0.3, gt=0.02, le=2.0, description="m, side of a marker's black square")
    dictionary: str = Field(
        "4X4_50",
        pattern="^((4X4|5X5|6X6|7X7)_(50|100|250|1000)|" + "|".join(NAMED_DICTIONARIES) + ")$",
        description="OpenCV ArUco dictionary, without DICT_",
    )
    layout: MarkerLayout = Field(MarkerLayout.CORNERS, description="top: one marker; corners: four")

    @model_validator(mode="after")
    def _markers_fit(self) -> "GateShape":
        if self.marker_size > self.border:
            raise ValueError(f"marker_size {self.marker_size} m is wider than the border, {self.border} m")
        return self

    @property
    def dictionary_size(self) -> int:
        """How many markers the dictionary has; ids count from 0."""
        return NAMED_DICTIONARIES.get(self.dictionary) or int(self.dictionary.partition("_")[2])

    @property
    def marker_count(self) -> int:
        """How many markers a gate carries."""
        return 1 if self.layout is MarkerLayout.TOP else 4

    def marker_corners(self) -> Vector:
        """(k, 4, 3) corners of each marker in the gate frame, in the order in which detectors give them.

        Seen on approach one looks along the gate's x axis, so left is +y and up is +z.
        """
        r = 0.5 * (self.opening + self.border)
        centres = [(0.0, r)] if self.layout is MarkerLayout.TOP else [(r, r), (-r, r), (-r, -r), (r, -r)]
        h = 0.5 * self.marker_size
        square = [(h, h), (-h, h), (-h, -h), (h, -h)]
        return np.array([[(0.0, y + dy, z + dz) for dy, dz in square] for y, z in centres])


class Uncertainty(BaseModel):
    """How well the place of a gate is known before the flight."""

    model_config = FORBID

    horizontal: float = Field(0.0, ge=0.0, le=20.0, description="m, radius of the disc that holds the gate")
    vertical: float = Field(0.0, ge=0.0, le=5.0, description="m, half-height of that disc")
    yaw_deg: float = Field(0.0, ge=0.0, le=90.0, description="°, greatest error of the yaw")


class MarkedGate(BaseModel):
    """A gate that can be told from others when it is seen."""

    model_config = FORBID

    id: int = Field(ge=0, description="the gate's name in maps and reports")
    markers: tuple[int, ...] = Field(description="marker ids in the order of the layout")


class Gate(MarkedGate):
    """A gate whose place is known, at least about."""

    position: Point = Field(description="m, centre of the opening")
    yaw_deg: Finite = Field(description="°, direction of passage")
    uncertainty: Uncertainty | None = Field(None, description="how well that is known; else as the track says")

    @property
    def yaw(self) -> float:
        """Direction of passage, rad."""
        return math.radians(self.yaw_deg)


class Start(BaseModel):
    """A point with a heading."""

    model_config = FORBID

    position: Point
    yaw_deg: Finite = 0.0

    @property
    def yaw(self) -> float:
        """Heading, rad."""
        return math.radians(self.yaw_deg)


class Box(BaseModel):
    """An axis-aligned solid box."""

    model_config = FORBID

    name: str
    centre: Point
    size: tuple[Length, Length, Length]

    def holds(self, point: Point) -> bool:
        """Whether ``point`` (m) is inside."""
        return all(abs(p - c) < 0.5 * side for p, c, side in zip(point, self.centre, self.size, strict=True))


class Cylinder(BaseModel):
    """An upright solid cylinder, such as a pillar."""

    model_config = FORBID

    name: str
    base: Point
    """m, the middle of its foot."""
    radius: Length
    height: Length

    def holds(self, point: Point) -> bool:
        """Whether ``point`` (m) is inside."""
        x, y, z = (p - b for p, b in zip(point, self.base, strict=True))
        return math.hypot(x, y) < self.radius and 0.0 < z < self.height


def _kind(entry: object) -> str:
    """Which obstacle an entry is meant to be, so that what is wrong with it is told of that kind alone."""
    if isinstance(entry, dict):
        return "(cylinder)" if entry.keys() & {"base", "radius", "height"} else "(box)"
    return "(cylinder)" if isinstance(entry, Cylinder) else "(box)"


Obstacle = Annotated[
    Annotated[Box, Tag("(box)")] | Annotated[Cylinder, Tag("(cylinder)")],
    Discriminator(_kind),
]


class Track(BaseModel):
    """Where to fly."""

    model_config = FORBID

    name: str
    start: Start
    gate: GateShape = GateShape()
    gates: tuple[Gate, ...] = ()
    unplaced: tuple[MarkedGate, ...] = ()
    """Gates of which nobody knows where they are, in the order of passage; there are either these or `gates`."""
    waypoints: tuple[Point, ...] = ()
    finish: Point | None = None
    uncertainty: Uncertainty = Uncertainty()
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def passage(self) -> tuple[MarkedGate, ...]:
        """All gates in the order of passage, whether their places are known or not."""
        return (*self.gates, *self.unplaced)

    def without_places(self) -> "Track":
        """What is left when only the number of the gates and their markers are known."""
        unplaced = tuple(MarkedGate(id=gate.id, markers=gate.markers) for gate in self.passage)
        return self.model_copy(update={"gates": (), "unplaced": unplaced, "uncertainty": Uncertainty()})

    @model_validator(mode="after")
    def _consistent(self) -> "Track":
        if not self.passage and not self.waypoints:
            raise ValueError("the track is empty: it needs at least one [[gates]] entry, or waypoints")
        if self.gates and self.unplaced:
            raise ValueError("the track has [[gates]] and [[unplaced]] gates; give the places of all gates or of none")
        gate_of: dict[int, int] = {}
        ids: set[int] = set()
        for gate in self.passage:
            if gate.id in ids:
                raise ValueError(f"gate id {gate.id} is used twice; give each gate its own id")
            ids.add(gate.id)
            self._check_markers(gate, gate_of)
        for placed in self.gates:
            lowest = placed.position[2] - 0.5 * self.gate.opening
            if lowest < 0.0:
                raise ValueError(
                    f"gate {placed.id} is underground: its opening begins at z = {lowest:.2f} m;"
                    f" raise position z to at least {0.5 * self.gate.opening:.2f}"
                )
        if self.start.position[2] < 0.0:
            raise ValueError(f"the start is underground: z = {self.start.position[2]:.2f} m")
        return self

    def _check_markers(self, gate: MarkedGate, gate_of: dict[int, int]) -> None:
        """Check the markers of ``gate``, and note whose they are."""
        if len(gate.markers) != self.gate.marker_count:
            raise ValueError(
                f"gate {gate.id} lists {len(gate.markers)} markers, but the layout"
                f" '{self.gate.layout}' has {self.gate.marker_count}"
            )
        for marker in gate.markers:
            if not 0 <= marker < self.gate.dictionary_size:
                raise ValueError(
                    f"gate {gate.id} has marker id {marker}, but dictionary {self.gate.dictionary}"
                    f" goes from 0 to {self.gate.dictionary_size - 1}"
                )
            if marker in gate_of:
                raise ValueError(
                    f"marker id {marker} is used twice, on gates {gate_of[marker]} and {gate.id};"
                    " a marker must tell its gate"
                )
            gate_of[marker] = gate.id

    @model_validator(mode="after")
    def _free_of_obstacles(self) -> "Track":
        names = [obstacle.name for obstacle in self.obstacles]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the obstacle name '{name}' is used twice; give each obstacle its own name")
        places = {"the start": self.start.position}
        places |= {f"the centre of gate {gate.id}": gate.position for gate in self.gates}
        places |= {f"waypoint {i}": point for i, point in enumerate(self.waypoints)}
        places |= {"the finish": self.finish} if self.finish else {}
        for obstacle in self.obstacles:
            for place, point in places.items():
                if obstacle.holds(point):
                    raise ValueError(f"{place} is inside the obstacle '{obstacle.name}'; move one of them")
        return self


def load_track(path: Path) -> Track:
    """Read and check a track; raises `BadInputError` that names the file, the field and the mend."""
    return validate(Track, read_toml(path, "track file"), str(path))
