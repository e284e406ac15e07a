"""Flights thinned to be kept and drawn."""

import numpy as np
import pytest
import synthetic_flight as synthetic

from flightapp.evaluation.flight import Flight
from flightapp.evaluation.metrics import racing_window
from flightapp.evaluation.trace import MOST, STEP, trace


def test_the_motion_inside_the_racing_window_is_kept():
    flight = synthetic.flight()
    window, kept = racing_window(flight), trace(flight)
    time = np.array(kept["time"])
    assert time[0] == 0.0
    assert time[-1] == pytest.approx(window.duration)
    assert len(time) <= MOST + 1
    assert np.all(np.diff(time) <= STEP + 1e-3)
    for source, motion in (("reference", flight.setpoints), ("estimate", flight.states), ("truth", flight.truth)):
        for name in ("position", "velocity"):
            rows, whole = np.array(kept[source][name]), getattr(motion, name)
            assert rows.shape == (len(time), 3)
            at = np.searchsorted(motion.stamp, window.start + time[20])
            assert rows[20] == pytest.approx(whole[at], abs=0.05)
    assert kept["gates"][0] == pytest.approx([-4.0, -8.0, 1.5, np.radians(17.0)], abs=1e-3)


def test_sources_that_were_not_recorded_are_missing():
    kept = trace(synthetic.flight(truth=False))
    assert "truth" not in kept
    assert kept["gates"] == []
    assert trace(Flight())["time"] == [0.0, 0.0]
