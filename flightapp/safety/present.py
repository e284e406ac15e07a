"""The faults that there are now, and what the gravest of them calls for."""

from flightapp.safety.faults import Fault, FaultKind, Reaction, Stage
from flightapp.safety.table import TABLE, reaction_to


class PresentFaults:
    """Keeps what has been told and is not over."""

    def __init__(self) -> None:
        self._present: dict[FaultKind, Fault] = {}

    def take(self, fault: Fault) -> bool:
        """Take ``fault`` over; whether that is news."""
        if fault.over:
            return self._present.pop(fault.kind, None) is not None
        new = fault.kind not in self._present
        self._present.setdefault(fault.kind, fault)
        return new

    @property
    def adrift(self) -> str:
        """The first fault with which state, line or commands are lost; empty where there is none."""
        return next((str(fault) for kind, fault in self._present.items() if TABLE[kind].adrift), "")

    def gravest(self, stage: Stage) -> tuple[Reaction, Fault | None]:
        """The gravest reaction in ``stage``, and the first fault that calls for it; None where nothing is to be done.

        What the race sees to by itself doesn't count.
        """
        worst: tuple[Reaction, Fault | None] = Reaction.CONTINUE, None
        for kind, fault in self._present.items():
            reaction = reaction_to(kind, stage)
            if reaction.gravity > worst[0].gravity and not TABLE[kind].by_race:
                worst = reaction, fault
        return worst
