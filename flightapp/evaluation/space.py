"""A flight in three dimensions: its path with gates, obstacles and geofence, and what moves there with the cursor."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from pydantic import ValidationError

from flightapp.config.safety import Geofence
from flightapp.config.vehicle import Camera
from flightapp.evaluation.figures import (
    ESTIMATE,
    ESTIMATED_GATE,
    EVENT_COLOURS,
    NOMINAL_GATE,
    POINTS,
    REFERENCE,
    TRUE_GATE,
    Subject,
    gate_sets,
    short,
    style,
)
from flightapp.evaluation.flight import Flight, Motions
from flightapp.evaluation.metrics import interpolated
from flightapp.evaluation.scene import (
    draw_line,
    draw_names,
    ellipsoids,
    frames,
    gate_lines,
    lay_out,
    prism_edges,
    solid,
    speed_colours,
)
from flightapp.frames import Vector
from flightapp.planning.geofence import Geofence as Prism
from flightapp.track import GateShape

PAD = 1.0
"""m around what is drawn."""
FAR = 2.5
"""A geofence that is so many times as wide as what is flown is drawn only when asked for."""
SIGHT = 0.1
"""Length of the camera's view as it is drawn, over the size of the scene."""
VEHICLE, VIEW = "vehicle", "camera's view"
"""Names of the traces that move with the cursor."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """The corners of what is drawn; each (3,) m."""

    low: Vector
    high: Vector

    @property
    def sight(self) -> float:
        """m, how far the camera's view is drawn."""
        return SIGHT * float(np.linalg.norm((self.high - self.low)[:2]))


def path_in_space(subject: Subject) -> go.Figure | None:
    """The path with its speed as colour, gates as they were surveyed, are and were estimated, obstacles, geofence."""
    if not subject.motion.stamp.size:
        return None
    figure = go.Figure()
    style(figure, "Path in space, coloured by speed")
    draw_surroundings(figure, subject)
    draw_gates(figure, subject)
    stamp, path, velocity = thinned(subject.motion)
    _draw_path(figure, stamp - subject.window.start, path, np.linalg.norm(velocity, axis=1))
    if subject.flight.has_truth:
        _, points, _ = thinned(subject.flight.states)
        draw_line(figure, points, "estimate", ESTIMATE, width=2, visible="legendonly")
    if subject.flight.setpoints.stamp.size:
        _, points, _ = thinned(subject.flight.setpoints)
        draw_line(figure, points, "reference", REFERENCE, width=2, dash="dash", visible="legendonly")
    _draw_troubles(figure, subject)
    draw_movers(figure, "#111827")
    limits = scene_bounds([subject])
    lay_out(figure, None, limits.low, limits.high)
    leave_room(figure)
    return figure


def leave_room(figure: go.Figure) -> None:
    """Room for the legend below the scene."""
    figure.update_layout(legend={"y": 0.0, "yanchor": "bottom", "font": {"size": 11}}, scene_domain_y=(0.1, 1.0))


def scene_bounds(subjects: Sequence[Subject]) -> Bounds:
    """The corners of what ``subjects`` need to be seen, with room around."""
    points = [np.zeros((1, 3))]
    for subject in subjects:
        points.append(subject.motion.position)
        border = subject.track.gate.border if subject.track else 0.0
        reach = np.array((-1.0, 1.0))[:, None, None] * (0.5 * subject.opening + border)
        for gates in gate_sets(subject).values():
            points += list(np.array([gate.position for gate in gates]) + reach)
        for obstacle in subject.track.obstacles if subject.track else ():
            mesh = solid(obstacle)
            points.append(np.column_stack((mesh.x, mesh.y, mesh.z)))
        if fence := fence_of(subject):
            around = np.column_stack((fence.corners, np.full(len(fence.corners), fence.floor)))
            points += [around, around + np.array((0.0, 0.0, fence.ceiling - fence.floor))]
    if any(subject.motion.stamp.size for subject in subjects):
        points = points[1:]
    every = np.concatenate(points)
    low, high = every.min(axis=0) - PAD, every.max(axis=0) + PAD
    low[2], high[2] = min(0.0, low[2] + PAD), high[2] - 0.5 * PAD  # so that flat scenes stay large
    return Bounds(low, high)


def draw_surroundings(figure: go.Figure, subject: Subject) -> None:
    """Obstacles, and the geofence if one is set."""
    for obstacle in subject.track.obstacles if subject.track else ():
        figure.add_trace(solid(obstacle))
    if fence := fence_of(subject):
        edges = prism_edges(fence.corners, fence.floor, fence.ceiling)
        draw_line(figure, edges, "geofence", EVENT_COLOURS["fault"], width=2, opacity=0.6)


def draw_gates(figure: go.Figure, subject: Subject) -> None:
    """Gates as they were surveyed, are, and were estimated at the end, with how uncertain that is."""
    shown = gate_sets(subject)
    shape = subject.track.gate if subject.track else GateShape(opening=subject.opening)
    if surveyed := shown.get("surveyed"):
        points = gate_lines(surveyed, subject.opening)
        draw_line(figure, points, "gates, surveyed", NOMINAL_GATE, width=4, dash="dot")
        if any(gate.covariance.any() for gate in surveyed):
            balls = ellipsoids(surveyed, NOMINAL_GATE, "survey, 3 σ").update(visible="legendonly", showlegend=True)
            figure.add_trace(balls)
    if true := shown.get("true"):
        figure.add_trace(frames(true, shape, "#64748b", "gates, true", 0.55).update(showlegend=True))
        draw_line(figure, gate_lines(true, subject.opening), "gates, true", TRUE_GATE, width=3, showlegend=False)
    if estimated := shown.get("estimated"):
        draw_line(figure, gate_lines(estimated, subject.opening), "gates, estimated", ESTIMATED_GATE, width=6)
        figure.add_trace(ellipsoids(estimated, ESTIMATED_GATE, "estimate, 3 σ").update(showlegend=True))
    named = next(reversed(list(shown.values())), ())
    if named:
        up = np.array((0.0, 0.0, 0.5 * subject.opening + shape.border + 0.2))
        draw_names(
            figure, np.array([g.position + up for g in named]), [str(g.gate_id) for g in named], [0.1] * len(named)
        )


def draw_movers(figure: go.Figure, *colours: str) -> None:
    """Room for vehicles, one of each colour, and the view of the first one's camera: the page's script fills it."""
    nowhere = np.full((1, 3), np.nan)
    for colour in colours:
        draw_line(figure, nowhere, VEHICLE, colour, width=7, showlegend=False)
    draw_line(figure, nowhere, VIEW, "#7c3aed", width=3, showlegend=False)


def thinned(motion: Any) -> tuple[Vector, Vector, Vector]:
    """Stamps (n,), positions (n, 3) and velocities (n, 3) of ``motion``, at most `POINTS` of them."""
    step = max(1, -(-motion.stamp.size // POINTS))
    return motion.stamp[::step], motion.position[::step], motion.velocity[::step]


def moving(subjects: Mapping[str, Subject], limits: Bounds) -> dict[str, Any]:
    """What the page's script needs to move vehicles, by the name of the run, and the first one's camera."""
    first = next(iter(subjects.values()))
    spans = [subject.span for subject in subjects.values()]
    return {
        "span": [round(min(span[0] for span in spans), 3), round(max(span[1] for span in spans), 3)],
        "runs": [_track_of(name, subject) for name, subject in subjects.items()],
        "view": _view(first.flight, limits.sight),
        "arm": round(max(0.012 * limits.sight / SIGHT, 0.12), 3),
    }


def fence_of(subject: Subject) -> Prism | None:
    """The geofence, if one other than the default's was set and it is not far away."""
    settings = _section(subject.flight, "geofence", Geofence)
    if settings is None or settings == Geofence():
        return None
    fence = Prism.of(settings)
    position = subject.motion.position[:, :2]
    flown = float(np.ptp(position, axis=0).max()) if position.size else 0.0
    return fence if np.ptp(fence.corners, axis=0).max() <= FAR * max(flown, 10.0) else None


def camera_of(flight: Flight) -> Camera | None:
    """The camera as the flight was told of it; None where the log does not say."""
    camera: Camera | None = _section(flight, "camera", Camera)
    return camera


def _section(flight: Flight, name: str, kind: Any) -> Any:
    """That section of the log's configuration; None where there is none, or one that this program cannot read."""
    try:
        settings = tomllib.loads(flight.header.get("config", "")).get(name)
        return None if settings is None else kind(**settings)
    except (tomllib.TOMLDecodeError, ValidationError, TypeError):
        return None


def _draw_path(figure: go.Figure, time: Vector, path: Vector, speed: Vector) -> None:
    x, y, z = short(path).T
    hover = "%{customdata:.2f} s<br>%{x:.2f}, %{y:.2f}, %{z:.2f} m<br>%{text}<extra></extra>"
    figure.add_trace(
        go.Scatter3d(
            **{"x": x, "y": y, "z": z, "mode": "lines", "showlegend": False, "name": "path"},
            line={"color": short(speed), "width": 6, **speed_colours(speed)},
            customdata=short(time),
            text=[f"{value:.2f} m/s" for value in speed],
            hovertemplate=hover,
        )
    )


def _draw_troubles(figure: go.Figure, subject: Subject) -> None:
    """Where the vehicle was when faults came up and things were touched."""
    flight, motion = subject.flight, subject.motion
    told = [(e.stamp, e.text) for e in flight.events if e.kind == "fault" and not e.text.endswith(" is over")]
    told += [(touch.stamp, f"touched {touch.obstacle}") for touch in flight.collisions]
    if not told:
        return
    x, y, z = short(interpolated(motion.stamp, motion.position, np.array([stamp for stamp, _ in told]))).T
    figure.add_trace(
        go.Scatter3d(
            **{"x": x, "y": y, "z": z, "mode": "markers", "name": "faults"},
            marker={"symbol": "x", "size": 6, "color": EVENT_COLOURS["fault"]},
            hovertext=[text[:90] for _, text in told],
            hoverinfo="text",
        )
    )


def _track_of(name: str, subject: Subject) -> dict[str, Any]:
    motion: Motions = subject.motion
    step = max(1, -(-motion.stamp.size // POINTS))
    orientation = motion.orientation[::step]
    return {
        "name": name,
        "time": np.round(motion.stamp[::step] - subject.window.start, 4).tolist(),
        "position": np.round(motion.position[::step], 3).tolist(),
        "orientation": np.round(orientation, 4).tolist(),
        "speed": np.round(np.linalg.norm(motion.velocity[::step], axis=1), 2).tolist(),
    }


def _view(flight: Flight, length: float) -> dict[str, Any] | None:
    """The camera's place in the body, and the ends of the rays (4, 3) through its image's corners, m, body."""
    camera = camera_of(flight)
    if camera is None:
        return None
    model = camera.model()
    w, h = model.width - 1.0, model.height - 1.0
    rays = model.bearings(np.array(((0.0, 0.0), (w, 0.0), (w, h), (0.0, h)))) @ model.R_bc.T
    return {"apex": model.p_bc.tolist(), "corners": np.round(model.p_bc + length * rays, 3).tolist()}
