"""Of several faults the gravest reaction counts."""

from hypothesis import given
from hypothesis import strategies as st

from flightapp.safety.faults import Fault, FaultKind, Reaction, Stage
from flightapp.safety.present import PresentFaults
from flightapp.safety.table import TABLE, reaction_to

TOLD = st.lists(st.tuples(st.sampled_from(FaultKind), st.booleans()), max_size=30)


@given(TOLD, st.sampled_from(Stage))
def test_the_gravest_of_those_that_are_not_over_counts(told, stage):
    present, faults = set(), PresentFaults()
    for stamp, (kind, over) in enumerate(told):
        news = faults.take(Fault(float(stamp), kind, "", over))
        assert news == ((kind in present) == over)
        present = present - {kind} if over else present | {kind}
    reaction, fault = faults.gravest(stage)
    expected = [reaction_to(kind, stage).gravity for kind in present if not TABLE[kind].by_race]
    assert reaction.gravity == max(expected, default=Reaction.CONTINUE.gravity)
    assert (fault is None) == (reaction is Reaction.CONTINUE)
    assert fault is None or reaction_to(fault.kind, stage) is reaction


def test_a_fault_reacts_otherwise_in_another_phase():
    faults = PresentFaults()
    faults.take(Fault(0.0, FaultKind.BATTERY_LOW, "19 % is left"))
    assert [faults.gravest(stage)[0] for stage in Stage] == ["refuse", "land", "slow", "continue"]
