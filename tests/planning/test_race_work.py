"""That the search for a race line is bounded, whatever it is asked for."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_tracks import FIVE_GATES, at_rest, request_for
from test_planner_contract import CROWDED

from flightapp.config import Config
from flightapp.interfaces import Limits, PlanningError, PlanRequest
from flightapp.planning import race, race_search
from flightapp.planning.race import RacePlanner
from flightapp.planning.race_search import EFFORT, Search
from flightapp.planning.race_solver import REFUSAL, STEP, TRIES, TRY
from flightapp.planning.race_step import REFUSALS
from flightapp.planning.race_work import Store

LAST = STEP + TRIES * TRY + REFUSALS * REFUSAL
"""The most effort that one step takes per segment, which may be begun with hardly any left."""
MOST = 16_000
"""Effort that any plan may take: some 40 ms at 2.5 GHz."""


def zigzag(points):
    """A course with sharp turns, up and down."""
    k = np.arange(points)
    return np.column_stack((2.0 * k, 3.0 * (k % 2), 3.0 + 1.5 * (k % 3)))


@pytest.fixture
def left(monkeypatch):
    """What is left after each part of a search, and how many segments it had."""
    seen = []

    class Counted(Search):
        def improve(self, line, problem, parameters, work):
            going = super().improve(line, problem, parameters, work)
            seen.append((self.effort, len(line) - 1))
            return going

    monkeypatch.setattr(race, "Search", Counted)
    return seen


@pytest.mark.parametrize("count, v_max", [(3, 4.0), (12, math.inf), (40, 3.0), (40, math.inf)])
def test_a_search_takes_no_more_than_its_effort(left, count, v_max):
    points = zigzag(count + 2)
    request = PlanRequest(0.0, at_rest(points[0]), (), points[-1], Limits(v_max, math.inf, 3.0))
    planner = RacePlanner(Config())
    try:
        trajectory = planner.through(points[1:-1], request)
    except PlanningError as refused:
        assert str(refused)
    else:
        peaks = trajectory.limits()
        assert peaks.speed <= 1.001 * v_max
        assert peaks.body_rate <= 1.001 * Config().planning.rate_share * Config().vehicle.rate_max
    assert left
    assert all(effort >= -LAST * segments for effort, segments in left)
    assert left[-1][0] < EFFORT


@pytest.mark.parametrize("kind", sorted(CROWDED))
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 100_000), gates=st.integers(2, 40))
def test_what_is_in_the_way_takes_no_more_effort(kind, seed, gates):
    seen = []

    class Kept(Search):
        def __init__(self, store):
            super().__init__(store)
            seen.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(race, "Search", Kept)
        try:
            RacePlanner(Config()).plan(CROWDED[kind](seed, gates))
        except PlanningError as refused:
            assert str(refused)
    assert all(EFFORT - search.effort <= MOST for search in seen)


def test_steps_are_paid_for(left):
    RacePlanner(Config()).plan(request_for(FIVE_GATES))
    (first, segments), *_ = left
    assert EFFORT - first >= STEP * segments


def test_with_little_effort_the_plan_is_slower_but_keeps_its_limits(monkeypatch):
    request = request_for(FIVE_GATES)
    whole = RacePlanner(Config()).plan(request)
    monkeypatch.setattr(race, "Search", lambda store: Search(store, 1_000))
    short = RacePlanner(Config()).plan(request)
    assert short.duration > whole.duration
    peaks = short.limits()
    assert peaks.speed <= 1.001 * request.limits.v_max
    assert peaks.acceleration <= 1.001 * request.limits.a_max


def test_without_effort_there_is_no_search():
    search = Search(Store(), race_search.FIRST.enough)
    assert not search.improve(np.zeros((41, 13)), None, race_search.FIRST, None)
    assert search.effort == race_search.FIRST.enough
