"""MAVLink commands and what PX4 answers to them."""

import asyncio
import json
import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage

from flightapp.interfaces import AutopilotError

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
REASON_WAIT = 0.3
"""s that status texts may take longer than the refusal that they explain."""
REASON_WINDOW = 1.0
"""s before a refusal in which a status text belongs to it."""


class Command(IntEnum):
    """MAV_CMD."""

    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    COMPONENT_ARM_DISARM = 400
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


ANSWERS = {
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "still in progress",
    6: "cancelled",
}
"""MAV_RESULT but ACCEPTED."""


class RefusedError(AutopilotError):
    """The autopilot answered no."""


class SilentError(AutopilotError):
    """The autopilot didn't answer."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line that the autopilot wrote for the pilot."""

    stamp: float
    severity: int
    """MAV_SEVERITY: 0 emergency to 7 debug."""
    text: str


class Commander:
    """Sends commands to one vehicle and explains refusals by the status texts that came with them."""

    def __init__(self, direct: MavlinkDirect, system_id: int) -> None:
        self._direct = direct
        self._system_id = system_id
        self._loop = asyncio.get_running_loop()
        self._texts: deque[StatusText] = deque(maxlen=16)

    def heard(self, text: StatusText) -> None:
        """Keep a status text: it may say why a command is refused."""
        self._texts.append(text)

    async def send(self, what: str, command: Command, *parameters: float) -> None:
        """Send COMMAND_LONG and wait for its final answer; ``what`` names it in words.

        Raises `RefusedError` with the autopilot's reason, `SilentError` when no answer comes (MAVSDK repeats the
        command, then gives up after about 2 s).
        """
        fields: dict[str, Any] = {
            "target_system": self._system_id,
            "target_component": AUTOPILOT,
            "command": int(command),
            "confirmation": 0,
        }
        for i in range(7):
            value = parameters[i] if i < len(parameters) else 0.0
            fields[f"param{i + 1}"] = None if math.isnan(value) else value  # null is how MAVSDK's JSON spells NaN
        answer: asyncio.Future[tuple[MavlinkDirectResult, str]] = self._loop.create_future()

        def answered(result: MavlinkDirectResult, ack: MavlinkMessage, _: object) -> None:
            self._loop.call_soon_threadsafe(_settle, answer, (result, ack.fields_json))

        message = MavlinkMessage("COMMAND_LONG", 0, 0, self._system_id, AUTOPILOT, json.dumps(fields))
        self._direct.send_command_async(message, answered)
        result, ack = await answer
        if result is not MavlinkDirectResult.SUCCESS:
            raise SilentError(f"{what}: no answer from the autopilot ({result.name.lower()})")
        code = int(json.loads(ack).get("result", 4))
        if code != 0:
            await asyncio.sleep(REASON_WAIT)
            raise RefusedError(f"{what} refused: {self._reason() or ANSWERS.get(code, f'result {code}')}")

    def _reason(self) -> str:
        """What the autopilot wrote lately that is a warning or worse."""
        since = self._loop.time() - REASON_WAIT - REASON_WINDOW
        lines = [text.text for text in self._texts if text.stamp >= since and text.severity <= 4]
        return "; ".join(dict.fromkeys(lines))


def _settle(
    answer: "asyncio.Future[tuple[MavlinkDirectResult, str]]", content: tuple[MavlinkDirectResult, str]
) -> None:
    if not answer.done():
        answer.set_result(content)
