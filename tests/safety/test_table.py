"""The fault table is complete, says why, and is what the documentation shows."""

from pathlib import Path

import pytest

from flightapp.config import Config
from flightapp.fault_command import cells_of
from flightapp.messages import Phase
from flightapp.modules import find
from flightapp.safety.document import document
from flightapp.safety.faults import MEANINGS, FaultKind, Reaction, Stage
from flightapp.safety.monitor import conditions
from flightapp.safety.table import TABLE, reaction_to

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("kind", FaultKind)
def test_every_fault_has_a_reaction_in_every_phase_or_says_why_it_cannot_occur(kind):
    row = TABLE[kind]
    assert row.what
    assert row.why
    missing = [stage for stage in Stage if stage not in row.reactions]
    assert bool(missing) == bool(row.cannot)
    assert row.reactions


def test_reactions_fit_their_phase():
    for row in TABLE.values():
        for stage, reaction in row.reactions.items():
            assert (reaction is Reaction.REFUSE) <= (stage is Stage.PREFLIGHT)
            assert stage is not Stage.PREFLIGHT or reaction in (Reaction.REFUSE, Reaction.CONTINUE)
            assert reaction not in (Reaction.SLOW, Reaction.HOLD) or stage is Stage.FLYING
            # What lands already can only be left to a pilot, or stopped on the ground.
            assert stage is not Stage.LANDING or reaction in (Reaction.CONTINUE, Reaction.KILL, Reaction.HAND_BACK)


def test_what_cannot_occur_changes_nothing():
    assert reaction_to(FaultKind.GATE_MISSED, Stage.PREFLIGHT) is Reaction.CONTINUE


def test_every_phase_of_the_mission_belongs_to_a_stage_and_the_pilot_comes_first():
    assert {Stage.of(phase) for phase in Phase} == set(Stage)
    assert Stage.of(Phase.LANDED) is Stage.LANDING
    assert max(Reaction, key=lambda reaction: reaction.gravity) is Reaction.HAND_BACK
    assert set(MEANINGS) == set(Reaction)


def test_every_fault_is_looked_for_by_the_monitor_or_told_by_who_notices_it():
    watched = {condition.kind for condition in conditions(Config(), gates=True)}
    told = {FaultKind.GATE_MISSED, FaultKind.GATE_NOT_FOUND, FaultKind.NO_COMMAND, FaultKind.TASK_FAILED}
    assert watched | told == set(FaultKind)
    assert not watched & told


def test_every_row_is_provoked_in_every_phase_that_it_names():
    trials = find("simulators", "faults")
    assert {(kind, stage) for kind, row in trials.items() for stage in row} == set(cells_of(()))


def test_thresholds_that_the_table_names_are_in_the_configuration():
    sections = Config.model_fields
    for row in TABLE.values():
        words = row.what.replace(",", " ").replace(":", " ").replace(";", " ").split()
        for word in (word.strip(".()") for word in words):
            section, dot, key = word.partition(".")
            if dot and section in sections:
                assert hasattr(getattr(Config(), section), key), word


def test_the_documentation_is_up_to_date():
    assert (ROOT / "docs" / "faults.md").read_text(encoding="utf-8") == document()
