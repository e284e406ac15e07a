"""The fault table as a page of the documentation."""

from flightapp.safety.faults import MEANINGS, Stage
from flightapp.safety.table import LAND, TABLE

INTRODUCTION = """# Faults

What can go wrong, how it is noticed, what is done then in each phase of a flight, and why. This page is made from
`flightapp/safety/table.py` (`flightapp faults --table`), which the flight itself goes by; `flightapp faults` provokes
each row in simulation at random moments of each phase, and judges by the truth and by the autopilot's mode.

A collision counts against the row unless the fault forces it (`flightapp/evaluation/forced.py`). That is so where
nobody steers from the fault on (no link, no state, no command, a pilot's hand) and what is hit was then, by the truth,
no further away than the vehicle needs to stop: it flies on until the autopilot has leaned back, which takes 0.25 s,
then slows down at 3 m/s², and a landing may go 0.3 m aside. It is also so where commands end and the autopilot flies
the last body rates on until COM_OF_LOSS_T is over, if by these the vehicle's tilt may come to more than 90° meanwhile;
and where the provocation itself lays the vehicle on the ground. Forced collisions are counted beside the others, and
what is broken before its reaction is due is not asked for it.

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
