"""The fault table as a page of the documentation."""

from flightapp.safety.faults import MEANINGS, Stage
from flightapp.safety.table import LAND, TABLE

INTRODUCTION = """# Faults

What can go wrong, how it is noticed, what is done then in each phase of a flight, and why. This page is made from
`flightapp/safety/table.py` (`flightapp faults --table`), which the flight itself goes by; `flightapp faults` provokes
each row in simulation at random moments of each phase, and judges by the truth and by the autopilot's mode.

Preflight lasts until the vehicle is armed, takeoff until the application takes command, flying until a landing is
asked for, landing until the motors are off; also the landing after a mission that was broken off. Where a reaction
of several faults is called for, the gravest counts, in this order:
"""


def document() -> str:
    """The page, in Markdown."""
    lines = [INTRODUCTION, "| reaction | what is done |", "| --- | --- |"]
    lines += [f"| {reaction} | {meaning} |" for reaction, meaning in MEANINGS.items()]
    lines += ["", "## Reactions", "", f"| fault | {' | '.join(Stage)} |", "| --- " * (1 + len(Stage)) + "|"]
    for kind, row in TABLE.items():
        lines.append(f"| {kind} | {' | '.join(row.reactions.get(stage, '–') for stage in Stage)} |")
    lines += ["", "## Each fault", ""]
    for kind, row in TABLE.items():
        cannot = f" Not in other phases: {row.cannot}." if row.cannot else ""
        race = " The race sees to it." if row.by_race else ""
        here = " It lands right where it is." if row.adrift and LAND in row.reactions.values() else ""
        lines += [f"**{kind}.** {row.what} {row.why}{here}{race}{cannot}", ""]
    return "\n".join(lines).rstrip() + "\n"
