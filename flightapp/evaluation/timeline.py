"""What happened when: phases, behaviors, gates, plans, faults and notices of a flight on its time axis."""

from collections.abc import Sequence

import plotly.graph_objects as go

from flightapp.evaluation.figures import ESTIMATE, EVENT_COLOURS, TRUTH, Subject, blank
from flightapp.evaluation.series import APART, MARGIN, spaced
from flightapp.messages import Outcome

ROWS = ("notices", "faults", "plans", "gates", "behaviors", "phases")
"""From below."""
PHASE_COLOURS = ("#cbd5e1", "#e2e8f0")
FAILED = "#dc2626"
HEIGHT = 250
"""px."""
LONGEST = 90
"""Characters of a text that is shown under the cursor."""


def timeline_figure(subject: Subject) -> go.Figure | None:
    """The events as rows of bars and marks, whose texts show under the cursor."""
    if not subject.flight.events:
        return None
    figure = blank("What happened", "time, s", "")
    _draw_phases(figure, subject)
    _draw_behaviors(figure, subject)
    _draw_gates(figure, subject)
    _draw_plans(figure, subject)
    _draw_faults(figure, subject)
    _draw_notices(figure, subject)
    figure.update_xaxes(range=list(subject.span), title_standoff=2)
    figure.update_yaxes(
        **{"categoryorder": "array", "categoryarray": ROWS, "range": [-0.5, len(ROWS) - 0.5]},
        **{"showgrid": False, "fixedrange": True, "automargin": False},
    )
    figure.update_layout(
        height=HEIGHT,
        barmode="overlay",
        bargap=0.25,
        showlegend=False,
        margin={**MARGIN, "t": 34, "b": 42},
        uniformtext={"minsize": 9, "mode": "hide"},
    )
    return figure


def _draw_phases(figure: go.Figure, subject: Subject) -> None:
    start, (_, last) = subject.window.start, subject.span
    events = [event for event in subject.flight.events if event.kind == "phase"]
    ends = [*(event.stamp - start for event in events[1:]), last]
    bars = []
    for k, (event, end) in enumerate(zip(events, ends, strict=False)):
        name = event.text.partition(":")[0]
        colour = FAILED if name == "aborted" else PHASE_COLOURS[k % 2]
        bars.append((event.stamp - start, end, name, event.text, colour))
    _draw_bars(figure, "phases", bars)


def _draw_behaviors(figure: go.Figure, subject: Subject) -> None:
    start, (first, _) = subject.window.start, subject.span
    bars, begin = [], first
    for event in subject.flight.events:
        name, _, rest = event.text.partition(": ")
        outcome = rest.partition(":")[0]
        if event.kind == "behavior" and outcome in set(Outcome):
            colour = TRUTH if outcome == Outcome.GOAL_ACHIEVED else FAILED
            bars.append((begin, event.stamp - start, name, event.text, colour))
            begin = event.stamp - start
    _draw_bars(figure, "behaviors", bars)


def _draw_gates(figure: go.Figure, subject: Subject) -> None:
    flight, start, (first, last) = subject.flight, subject.window.start, subject.span
    if flight.has_truth:
        marks = [
            (p.stamp - start, "passage", f"gate {p.gate_id}, {p.offset:.2f} m from its centre") for p in flight.passages
        ]
    else:
        passed = [event for event in flight.events if event.kind == "gate" and " passed" in event.text]
        marks = [(event.stamp - start, "passage", event.text) for event in passed]
    labelled = {mark[0]: mark[2].split()[1].rstrip(",") for mark in spaced(marks, APART * (last - first))}
    _draw_marks(
        figure,
        "gates",
        [(x, text) for x, _, text in marks],
        {"symbol": "square", "size": 9, "color": EVENT_COLOURS["passage"]},
        [labelled.get(x, "") for x, _, _ in marks],
    )


def _draw_plans(figure: go.Figure, subject: Subject) -> None:
    start = subject.window.start
    for accepted, symbol, colour in ((True, "line-ns", ESTIMATE), (False, "x-thin", FAILED)):
        marks = [
            (plan.stamp - start, f"planned in {1e3 * plan.elapsed:.1f} ms" if accepted else f"refused: {plan.reason}")
            for plan in subject.flight.plans
            if plan.accepted == accepted
        ]
        look = {"symbol": symbol, "size": 9, "color": colour, "line": {"width": 2, "color": colour}}
        _draw_marks(figure, "plans", marks, look)


def _draw_faults(figure: go.Figure, subject: Subject) -> None:
    flight, start = subject.flight, subject.window.start
    marks = [(touch.stamp - start, f"touched {touch.obstacle} at {touch.speed:.1f} m/s") for touch in flight.collisions]
    begun: dict[str, float] = {}
    for event in flight.events:
        if event.kind != "fault":
            continue
        time = event.stamp - start
        if event.text.endswith(" is over"):
            since = begun.pop(event.text.removesuffix(" is over"), time)
            _draw_stroke(figure, "faults", since, time)
        else:
            begun[event.text.partition(":")[0]] = time
            marks.append((time, event.text))
    look = {"symbol": "diamond", "size": 9, "color": FAILED}
    _draw_marks(figure, "faults", marks or [(None, "")], look)


def _draw_notices(figure: go.Figure, subject: Subject) -> None:
    start = subject.window.start
    shown = ("phase", "fault")
    told = [event for event in subject.flight.events if event.kind not in shown and "GOAL_ACHIEVED" not in event.text]
    marks = [(event.stamp - start, f"{event.kind}: {event.text}") for event in told]
    _draw_marks(figure, "notices", marks or [(None, "")], {"symbol": "circle", "size": 7, "color": "#64748b"})


def _draw_bars(figure: go.Figure, row: str, bars: Sequence[tuple[float, float, str, str, str]]) -> None:
    """``bars``: start, end, what is written in them where it fits, what under the cursor, colour."""
    figure.add_trace(
        go.Bar(
            base=[bar[0] for bar in bars],
            x=[bar[1] - bar[0] for bar in bars],
            y=[row] * len(bars),
            orientation="h",
            text=[bar[2] for bar in bars],
            hovertext=[_clipped(bar[3]) for bar in bars],
            hoverinfo="text",
            marker_color=[bar[4] for bar in bars],
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
        )
    )


def _draw_marks(
    figure: go.Figure,
    row: str,
    marks: Sequence[tuple[float | None, str]],
    look: dict[str, object],
    labels: Sequence[str] | None = None,
) -> None:
    """``marks``: time, and what shows under the cursor; ``labels`` are written beside them."""
    figure.add_trace(
        go.Scatter(
            x=[mark[0] for mark in marks],
            y=[row] * len(marks),
            mode="markers" if labels is None else "markers+text",
            marker=look,
            text=labels,
            textposition="bottom center",
            textfont={"size": 10},
            hovertext=[_clipped(mark[1]) for mark in marks],
            hoverinfo="text",
            cliponaxis=False,
        )
    )


def _draw_stroke(figure: go.Figure, row: str, begin: float, end: float) -> None:
    pen = {"color": FAILED, "width": 3}
    figure.add_trace(go.Scatter(x=[begin, end], y=[row, row], mode="lines", line=pen, hoverinfo="skip"))


def _clipped(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
