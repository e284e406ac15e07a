"""How the sender of commands did over a flight: punctuality of its ticks, and what the guard made of the commands."""

import json
from dataclasses import asdict, dataclass

from flightapp.autopilot.guard import GuardCounts
from flightapp.timing import TickStatistics


@dataclass(frozen=True, slots=True)
class SenderReport:
    """From the task's start to its end, on the ground too."""

    ticks: TickStatistics
    guard: GuardCounts

    def line(self) -> str:
        """One line for the log."""
        ticks, guard = self.ticks, self.guard
        reasons = "; ".join(f"{count} × {refusal}" for refusal, count in guard.reasons.items())
        return (
            f"sender: {ticks.rate:.1f} Hz, between ticks p50 {1e3 * ticks.p50:.2f} ms, p99 {1e3 * ticks.p99:.2f} ms,"
            f" p99.9 {1e3 * ticks.p999:.2f} ms, {ticks.overruns} overruns; commands: {guard.passed} passed,"
            f" {guard.clipped} of them clipped, {guard.held} held by the guard, {guard.refused} refused"
            + (f" ({reasons})" if reasons else "")
        )

    def entry(self) -> str:
        """The guard's counts as JSON, for the header of the flight's log, from which summary.json takes them."""
        return json.dumps({"guard": asdict(self.guard)}, ensure_ascii=False)
