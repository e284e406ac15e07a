"""Whether a vehicle is fit for indoor flight on external vision with offboard body rates; and mending its parameters.

Nothing is written but by `mend`, which the caller has had confirmed.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from flightapp.autopilot import examination
from flightapp.autopilot.clock import RoundTrip
from flightapp.autopilot.diagnosis import Diagnosis, Light, Line, value_text
from flightapp.autopilot.parameter_store import ParameterMissingError
from flightapp.autopilot.parameters import Finding, Parameter, Value, compare, number_text, same
from flightapp.autopilot.telemetry import Identity
from flightapp.autopilot.wanted_parameters import Profile, wanted_parameters
from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.interfaces import AutopilotError
from flightapp.messages import AutopilotStatus

LISTEN = 3.0
"""s of telemetry from which rates are told."""
PATIENCE = 3
"""Failed reads in a row after which the rest isn't tried."""
SETTLE = 0.2
"""s for what came in meanwhile to be taken in."""
MENDING = "--fix"


class Parameters(Protocol):
    """The vehicle's parameters, as `parameter_store.ParameterStore` has them."""

    async def read(self, name: str) -> Value:
        """A value; raises `ParameterMissingError`, or `AutopilotError` where nothing answers."""
        ...

    async def write(self, name: str, value: Value) -> None:
        """Set a value, an int as a 32 bit integer and a float as a 32 bit float; raises as `read` does."""
        ...


class DoctorLink(Protocol):
    """What an examination needs of a link; `link.Px4Link` is one."""

    @property
    def status(self) -> Topic[AutopilotStatus]:
        """What the autopilot last said of itself, stamped with the loop's time."""
        ...

    @property
    def identity(self) -> Identity | None:
        """Which vehicle it is; None where it didn't say."""
        ...

    @property
    def round_trip(self) -> RoundTrip | None:
        """Time to the autopilot and back; None where there was no answer."""
        ...

    @property
    def parameters(self) -> Parameters:
        """Its parameters."""
        ...

    def rates(self) -> Mapping[str, float]:
        """Hz at which each message comes in, by its MAVLink name."""
        ...

    async def connect(self) -> None:
        """Find the vehicle; raises `AutopilotError`."""
        ...

    async def close(self) -> None:
        """Give the link back."""
        ...


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter that would be written."""

    parameter: Parameter
    old: Value | None
    new: Value

    @property
    def text(self) -> str:
        """Such as "EKF2_HGT_REF: 1 → 3 (counts after a reboot)"."""
        reboot = " (counts after a reboot)" if self.parameter.reboot else ""
        return f"{self.parameter.name}: {value_text(self.old)} → {number_text(self.new)}{reboot}"


@dataclass(frozen=True, slots=True)
class Written:
    """What became of a change."""

    change: Change
    read_back: Value | None
    """None where it could not be written, or not be read back."""
    error: str = ""

    @property
    def good(self) -> bool:
        """Whether the autopilot now has the new value."""
        return self.read_back is not None and same(self.read_back, self.change.new)


Confirm = Callable[[Sequence[Change]], bool]
"""Shows what would be written and says whether to."""


def visit(
    open_link: Callable[[Config], DoctorLink], config: Config, profile: Profile, confirm: Confirm | None
) -> Diagnosis:
    """Examine the vehicle on ``config``'s link and, with ``confirm``, mend its parameters; on an event loop of its own.

    Raises `BadInputError` where the connection can't be opened.
    """
    return asyncio.run(_visit(open_link, config, profile, confirm))


async def _visit(
    open_link: Callable[[Config], DoctorLink], config: Config, profile: Profile, confirm: Confirm | None
) -> Diagnosis:
    link = open_link(config)
    try:
        diagnosis = await examine(link, config, profile, LISTEN)
        todo = changes(diagnosis)
        # The question holds the loop up: nothing is in flight, and an interrupt must end it.
        if confirm is None or not todo or not confirm(todo):
            return diagnosis
        await asyncio.sleep(SETTLE)
        try:
            return mended(diagnosis, await mend(link, todo))
        except AutopilotError as error:
            return with_lines(diagnosis, Line(MENDING, "refused", Light.RED, str(error), mend="disarm the vehicle"))
    finally:
        await link.close()


async def examine(
    link: DoctorLink, config: Config, profile: Profile = Profile.CAGE, listen: float = LISTEN
) -> Diagnosis:
    """Connect and look at everything that the link tells; it stays open.

    Listens to telemetry for ``listen`` s. A vehicle that isn't there, or goes silent, is a finding and not an error.
    """
    try:
        await link.connect()
    except AutopilotError as error:
        return Diagnosis(str(profile), (examination.unconnected(config, str(error)),), ())
    loop = asyncio.get_running_loop()
    heard_long_enough = loop.time() + listen
    findings = await read_all(link, wanted_parameters(config, profile))
    await asyncio.sleep(heard_long_enough - loop.time())
    vehicle = (
        examination.identity(link.identity, config),
        *examination.streams(link.rates(), config),
        examination.round_trip(link.round_trip),
        *examination.status(link.status.latest, loop.time(), config),
    )
    return Diagnosis(str(profile), vehicle, findings)


async def read_all(link: DoctorLink, wanted: Sequence[Parameter]) -> tuple[Finding, ...]:
    """Every parameter of ``wanted`` as the vehicle has it; gives up soon where nothing answers."""
    values: dict[str, Value | None] = {}
    failed = 0
    for parameter in wanted:
        try:
            values[parameter.name] = await link.parameters.read(parameter.name)
            failed = 0
        except ParameterMissingError:
            # PX4 keeps silent about a name that it doesn't know, and so does one that is gone.
            if link.rates().get("HEARTBEAT", 0.0) > 0.0:
                values[parameter.name] = None
            else:
                failed += 1
        except AutopilotError:
            failed += 1
        if failed >= PATIENCE:
            break
    return compare(wanted, values)


def changes(diagnosis: Diagnosis) -> tuple[Change, ...]:
    """What mending would write, in the order of the table."""
    return tuple(
        Change(finding.parameter, finding.value, new)
        for finding in diagnosis.findings
        if (new := finding.mend) is not None
    )


async def mend(link: DoctorLink, todo: Sequence[Change]) -> tuple[Written, ...]:
    """Write ``todo`` and read each back.

    Raises `AutopilotError`, and stops, unless the vehicle is known to be disarmed.
    """
    done: list[Written] = []
    for change in todo:
        status = link.status.latest
        if status is None or status.armed:
            why = "it is armed" if status is not None else "whether it is armed is not known"
            raise AutopilotError(f"parameters are not written while flying: {why}; {len(done)} were written")
        done.append(await _write(link, change))
        if not any(written.good for written in done[-PATIENCE:]) and len(done) >= PATIENCE:
            break
    return tuple(done)


async def _write(link: DoctorLink, change: Change) -> Written:
    name = change.parameter.name
    try:
        await link.parameters.write(name, change.new)
        return Written(change, await link.parameters.read(name))
    except AutopilotError as error:
        return Written(change, None, str(error))


def mended(diagnosis: Diagnosis, done: Sequence[Written]) -> Diagnosis:
    """``diagnosis`` with what was read back in place of what was found, and a line on what is still to do."""
    values = {written.change.parameter.name: written.read_back for written in done if written.read_back is not None}
    findings = [
        compare([found.parameter], values)[0] if found.parameter.name in values else found
        for found in diagnosis.findings
    ]
    lines = [_written_line(written) for written in done]
    reboot = [w.change.parameter.name for w in done if w.good and w.change.parameter.reboot]
    if reboot:
        lines.append(Line(MENDING, "reboot", Light.AMBER, ", ".join(reboot), "in force", "reboot the autopilot"))
    return with_lines(replace(diagnosis, findings=tuple(findings)), *lines)


def _written_line(written: Written) -> Line:
    change = written.change
    if written.good:
        return Line(MENDING, change.parameter.name, Light.GREEN, f"written: {change.text}")
    kept = f"the autopilot kept {value_text(written.read_back)}"
    found = written.error or kept
    return Line(MENDING, change.parameter.name, Light.RED, found, number_text(change.new), "set it by hand")


def with_lines(diagnosis: Diagnosis, *lines: Line) -> Diagnosis:
    """``diagnosis`` with ``lines`` after its own."""
    return replace(diagnosis, lines=(*diagnosis.lines, *lines))
