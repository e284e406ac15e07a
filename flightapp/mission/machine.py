"""The mission state machine: which phase the flight is in, and every change of it with its cause."""

from flightapp.channel import Topic
from flightapp.messages import Event, Phase

NEXT: dict[Phase, frozenset[Phase]] = {
    Phase.IDLE: frozenset({Phase.PREFLIGHT}),
    Phase.PREFLIGHT: frozenset({Phase.ARMED, Phase.IDLE}),
    Phase.ARMED: frozenset({Phase.TAKEOFF}),
    Phase.TAKEOFF: frozenset({Phase.FLYING}),
    Phase.FLYING: frozenset({Phase.LANDING}),
    Phase.LANDING: frozenset({Phase.LANDED}),
    Phase.LANDED: frozenset({Phase.PREFLIGHT}),
    Phase.ABORTED: frozenset(),
}
"""What may follow what; ABORTED may follow anything."""


class IllegalTransitionError(Exception):
    """A mission asked for something out of order; the text says what and what is possible."""


class MissionMachine:
    """Holds the phase. Every transition is published with its cause."""

    def __init__(self, phase: Topic[Phase], events: Topic[Event]) -> None:
        self._topic = phase
        self._events = events
        self._topic.publish(Phase.IDLE)
        self._phase = Phase.IDLE

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self._phase

    def check(self, target: Phase) -> None:
        """Raise `IllegalTransitionError` unless ``target`` may follow now."""
        if target is self._phase or target is Phase.ABORTED or target in NEXT[self._phase]:
            return
        possible = ", ".join(sorted(NEXT[self._phase])) or "nothing"
        raise IllegalTransitionError(f"{target} can't follow {self._phase}; from here: {possible}")

    def go(self, target: Phase, stamp: float, cause: str) -> None:
        """Enter ``target`` because of ``cause``; staying where one is changes nothing."""
        self.check(target)
        if target is self._phase:
            return
        self._phase = target
        self._topic.publish(target)
        self._events.publish(Event(stamp, "phase", f"{target}: {cause}"))
