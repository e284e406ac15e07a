"""Sightings that the map refuses vote on where a gate has moved to."""

import numpy as np
import pytest

from flightapp.config import Config
from flightapp.mapping.register import GateRegister
from flightapp.track import Gate, GateShape, Start, Track, Uncertainty

HERE, THERE = np.array((3.0, 0.0, 1.5)), np.array((3.0, 2.0, 1.5))


def register(rough=True):
    track = Track(
        name="one",
        start=Start(position=(0.0, 0.0, 0.0), yaw_deg=0.0),
        finish=(9.0, 0.0, 1.5),
        gate=GateShape(layout="top"),
        uncertainty=Uncertainty(horizontal=3.0 if rough else 0.1),
        gates=(Gate(id=1, position=(3.0, 0.0, 1.5), yaw_deg=0.0, markers=(0,)),),
    )
    return GateRegister(Config(), track)


def needed(book, places, begin=10.0):
    """After how many of the refused sightings at ``places`` the gate counts as moved; None where it does not."""
    for k, place in enumerate(places):
        if book.refused(0, begin + k / 30.0, place):
            return k + 1
    return None


@pytest.mark.parametrize(("used", "votes"), [(0, 3), (1, 4), (5, 8), (100, 15)])
def test_few_sightings_are_outvoted_by_few(used, votes):
    book = register()
    for k in range(used):
        book.gates[0].used(k / 30.0)
    assert needed(book, [THERE] * 30) == votes


def test_a_surveyed_gate_takes_all_the_votes():
    assert needed(register(rough=False), [THERE] * 30) == 15


def test_false_sightings_among_them_only_delay_it():
    rng = np.random.default_rng(3)
    book = register()
    book.gates[0].used(0.0)
    places = [THERE if k % 3 else rng.uniform(-9.0, 9.0, 3) for k in range(60)]
    assert 4 < needed(book, places) <= 15


def test_false_sightings_at_ever_other_places_move_nothing():
    rng = np.random.default_rng(4)
    book = register()
    for k in range(20):
        book.gates[0].used(k / 30.0)
    assert needed(book, rng.uniform(-9.0, 9.0, (3000, 3))) is None


def test_a_sighting_that_fits_ends_the_vote():
    book = register()
    for k in range(40):
        book.gates[0].used(k / 30.0)
    for k in range(100):
        assert not book.refused(0, 2.0 + k / 15.0, THERE)
        book.gates[0].used(2.0 + k / 15.0)


def test_only_refusals_at_one_place_tell_of_a_second_gate():
    rng = np.random.default_rng(5)
    doubled, scattered = register(), register()
    for k in range(20):
        for book, place in ((doubled, THERE), (scattered, rng.uniform(-9.0, 9.0, 3))):
            book.gates[0].used(k / 30.0)
            book.refused(0, k / 30.0, place)
    assert any("two places" in notice for notice in doubled.notices)
    assert not scattered.notices


def two_gates(seen_since):
    """Whom the first of two gates ousts, that is found where the second is thought to be, 8 m away."""
    track = Track(
        name="two",
        start=Start(position=(0.0, 0.0, 0.0), yaw_deg=0.0),
        gates=(
            Gate(id=1, position=(3.0, 0.0, 1.5), yaw_deg=0.0, markers=(0, 1, 2, 3)),
            Gate(id=2, position=(3.0, 8.0, 1.5), yaw_deg=0.0, markers=(4, 5, 6, 7)),
        ),
    )
    book = GateRegister(Config(), track)
    book.gates[1].used(1.0)
    for k in range(10):
        book.refused(0, 2.0 + k / 30.0, np.array((3.0, 7.8, 1.5)))
    if seen_since:
        book.gates[1].used(2.2)
    return book


def test_two_gates_do_not_stand_in_one_place():
    places, sharp, vague = np.array(((3.0, 0.0, 1.5), (3.0, 8.0, 1.5))), np.full(2, 0.05), np.full(2, 1.6)
    there, between, beside = np.array((3.0, 7.8, 1.5)), np.array((3.0, 5.0, 1.5)), np.array((3.0, 2.0, 1.5))
    assert two_gates(False).ousted(0, there, places, sharp) == 1
    assert two_gates(True).ousted(0, there, places, sharp) is None
    assert two_gates(False).ousted(0, between, places, sharp) is None
    assert two_gates(False).ousted(0, between, places, vague) == 1
    assert two_gates(False).ousted(0, beside, places, np.full(2, 9.0)) is None


def test_a_gate_that_is_seen_close_beside_its_place_is_not_said_to_have_moved():
    for place, moved in ((HERE + np.array((0.3, 0.2, 0.0)), False), (THERE, True)):
        book = register()
        book.placed_anew(0, 1.0, place, HERE)
        (notice,) = book.notices
        assert ("has moved" in notice) == moved
        assert ("calibrated" in notice) != moved
