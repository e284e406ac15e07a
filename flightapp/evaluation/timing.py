"""How long things took, as histograms."""

import math
from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go

from flightapp.evaluation.figures import ESTIMATE, EVENT_COLOURS, Subject, blank
from flightapp.evaluation.latency import passages
from flightapp.evaluation.metrics import Window
from flightapp.frames import Vector

BINS = 60
HEIGHT = 300
"""px."""


TITLES = {
    "intervals": "Time between commands",
    "arrivals": "Time between commands that arrived",
    "plan": "Time to plan",
    "detection": "Time to detect",
    "camera to command": "From an image to the command that heeds it",
    "pose to command": "From a pose to its command",
}


def timing_figures(subject: Subject) -> Mapping[str, go.Figure]:
    """A histogram of each time that the flight has data for, by name, in the order of the report."""
    samples = timing_samples(subject)
    return {
        name.replace(" ", "-"): histogram(title, samples[name]) for name, title in TITLES.items() if samples[name].size
    }


def timing_samples(subject: Subject) -> Mapping[str, Vector]:
    """Times (n,) in ms inside the window, by name as in `TITLES`."""
    flight, window = subject.flight, subject.window
    arrivals = np.concatenate([batch.stamps for batch in flight.arrivals]) if flight.arrivals else np.zeros(0)
    stages = {name: 1e3 * times for name, times in passages(flight, window).items()}
    return {
        **stages,
        "plan": np.array([1e3 * p.elapsed for p in flight.plans if window.start <= p.stamp <= window.end]),
        "intervals": _between(flight.commands.stamp, window),
        "arrivals": _between(arrivals, window),
    }


def histogram(title: str, values: Vector) -> go.Figure:
    """How often each of ``values`` (n,) in ms came, with the median and the 99th percentile."""
    p50, p99 = np.percentile(values, (50.0, 99.0))
    told = f"ms · p50 {p50:.2f} (dashed) · p99 {p99:.2f} (dotted)"
    figure = blank(title, told, "how often")
    low, high = float(values.min()), float(values.max())
    if high - low < 1.0:  # ticks of virtual time differ by rounding alone, which has no room for bins
        low, high = 0.5 * (low + high) - 0.5, 0.5 * (low + high) + 0.5
    counts, edges = np.histogram(values, bins=BINS, range=(low, high))
    middle = 0.5 * (edges[:-1] + edges[1:])
    bars = go.Bar(x=middle, y=counts, width=np.diff(edges), marker_color=ESTIMATE, name="how often")
    figure.add_trace(bars)
    for value, dash in ((p50, "dash"), (p99, "dot")):
        pen = {"color": EVENT_COLOURS["fault"], "width": 1.5, "dash": dash}
        figure.add_vline(float(value), line=pen)
    most = math.log10(max(int(counts.max()), 1))
    figure.update_yaxes(type="log", dtick=1, range=[-0.3, most + 0.3])
    figure.update_layout(height=HEIGHT, showlegend=False, margin={"l": 62, "r": 14, "t": 44, "b": 50})
    return figure


def _between(stamps: Vector, window: Window) -> Vector:
    """ms between those of ``stamps`` that are inside ``window``."""
    between: Vector = 1e3 * np.diff(np.sort(stamps[window.holds(stamps)]))
    return between
