"""Turns what a mission asks for into activations that are consistent with each other, and watches over them."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Any

from flightapp.behaviors.base import Behavior, Context, Result
from flightapp.messages import Event, Outcome, Phase
from flightapp.modules import find

WATCH_INTERVAL = 0.05
"""s between looks at an active behavior's inputs and course."""
INPUT_PATIENCE = 0.3
"""s for which inputs may be missing: what lasts longer is a failure."""
COURSE_PATIENCE = 1.0
"""s for which a behavior may be off its course: a map that was corrected moves the line all at once."""

LETTING_GO = 3.0
"""s that a behavior, or a mission, may take to end: the autopilot's answer to a request to arm is waited for."""

AnyBehavior = Behavior[Any]


class Activation:
    """One behavior at work; it ends when its work does, when it is stopped, or when nobody wants it any more."""

    def __init__(self, behavior: AnyBehavior) -> None:
        self.behavior = behavior
        self.users = 0
        """How many have activated it."""
        self._why = ""
        self._begun = asyncio.Event()
        self._going = asyncio.Event()
        self._going.set()
        self._task = asyncio.create_task(self._run(), name=f"behavior {behavior.name}")

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._task.done()

    @property
    def progress(self) -> float:
        """How much of it is done, 0 to 1."""
        return min(max(self.behavior.progress, 0.0), 1.0)

    async def result(self) -> Result:
        """How it ended; waits for that, and being cancelled meanwhile changes nothing about it."""
        return await asyncio.shield(self._task)

    async def stop(self, why: str) -> Result:
        """Have it end as INTERRUPTED because of ``why``, unless it has ended; the vehicle is left in safety."""
        await self._begun.wait()  # a task that is cancelled before it has begun could not leave anything in safety
        if not self._task.done() and not self._why:
            self._why = why
            self._task.cancel()
        return await asyncio.shield(self._task)

    def suspend(self) -> None:
        """Have the vehicle stop along its line and wait; the work begins again with `resume`."""
        self._going.clear()

    def resume(self) -> None:
        """Go on after `suspend`."""
        self._going.set()

    async def _run(self) -> Result:
        behavior = self.behavior
        self._begun.set()
        try:
            async with asyncio.timeout(behavior.timeout) as limit:
                return await self._work(limit)
        except TimeoutError:
            behavior.stopped()
            return Result(Outcome.TIME_OUT, f"not done within {behavior.timeout:g} s")
        except asyncio.CancelledError:
            behavior.stopped()
            if task := asyncio.current_task():
                task.uncancel()
            return Result(Outcome.INTERRUPTED, self._why or "the flight is over")
        except Exception as error:  # whatever an algorithm raises must end in a landing, not in a fall
            behavior.stopped()
            return Result(Outcome.PROCESS_FAILURE, f"{type(error).__name__}: {error}")

    async def _work(self, limit: asyncio.Timeout) -> Result:
        while True:
            running = asyncio.create_task(self.behavior.run(), name=self.behavior.name)
            try:
                result = await self._watched(running)
            finally:
                await _ended(running)
            if result is not None:
                return result
            self.behavior.stopped()
            await self._wait(limit)

    async def _wait(self, limit: asyncio.Timeout) -> None:
        """Until it goes on; meanwhile its time stands still."""
        now = self.behavior.context.now
        begun, end = now(), limit.when()
        limit.reschedule(None)
        await self._going.wait()
        if end is not None:
            limit.reschedule(end + now() - begun)

    async def _watched(self, running: "asyncio.Task[Result]") -> Result | None:
        """What ``running`` comes to, or why it must not go on; None when it was suspended."""
        behavior, now = self.behavior, self.behavior.context.now
        sound = on_course = last = now()
        while True:
            await asyncio.wait((running,), timeout=WATCH_INTERVAL)
            if running.done():
                return running.result()
            if not self._going.is_set():
                return None
            missing, off_course = behavior.missing(), behavior.off_course()
            # After a stall of the process what has come meanwhile is still to be heard: the stall does not count.
            stalled = max(now() - last - 2.0 * WATCH_INTERVAL, 0.0)
            last = now()
            sound = sound + stalled if missing else now()
            on_course = on_course + stalled if off_course else now()
            if now() - sound > INPUT_PATIENCE:
                return self._broken_off(Outcome.PROCESS_FAILURE, missing)
            if now() - on_course > COURSE_PATIENCE:
                return self._broken_off(Outcome.WRONG_PROGRESS, off_course)

    def _broken_off(self, outcome: Outcome, reason: str) -> Result:
        self.behavior.stopped()
        return Result(outcome, reason)


class Coordinator:
    """Activates behaviors under their constraints. At any time at most one of them holds the motion command.

    An activation that can't be beside another stops it where its priority is higher, and is refused otherwise. What
    a behavior needs is activated for it. The same behavior asked for twice is the same activation.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._active: list[Activation] = []
        self._over = False

    @property
    def active(self) -> tuple[AnyBehavior, ...]:
        """The behaviors at work."""
        return tuple(activation.behavior for activation in self._active if not activation.done)

    @property
    def holder(self) -> AnyBehavior | None:
        """The behavior that holds the motion command; without one the line's end is held, or the autopilot flies."""
        return next((behavior for behavior in self.active if behavior.moves), None)

    async def close(self) -> None:
        """The mission is over: stop what is at work, and refuse whatever its tasks still ask for.

        A behavior that does not let itself be stopped is left alone after `LETTING_GO`.
        """
        self._over = True
        stops = [asyncio.create_task(activation.stop("the mission is over")) for activation in self._active]
        if stops:
            await asyncio.wait(stops, timeout=LETTING_GO)

    async def run(self, behavior: AnyBehavior) -> Result:
        """Activate ``behavior`` and wait until it ends; never raises but for cancellation, which stops it."""
        async with self.activate(behavior) as activation:
            return activation if isinstance(activation, Result) else await activation.result()

    @contextlib.asynccontextmanager
    async def activate(self, behavior: AnyBehavior) -> AsyncIterator[Activation | Result]:
        """``behavior`` at work within an ``async with``, at whose end it is stopped; a `Result` where it is refused."""
        activation = self._same(behavior)
        if activation is None:
            refused = await self._make_way(behavior)
            if refused is not None:
                self._tell(behavior, refused)
                yield refused
                return
            activation = Activation(behavior)
            self._active.append(activation)
            self._publish_active()
        activation.users += 1
        try:
            yield activation
        finally:
            activation.users -= 1
            if not activation.users:
                await self._finish(activation)

    async def _finish(self, activation: Activation) -> None:
        try:
            result = await activation.stop("given up by the mission")
            self._tell(activation.behavior, result)
        finally:
            self._active.remove(activation)
            self._publish_active()

    def _publish_active(self) -> None:
        self._context.bus.behaviors.publish(tuple(behavior.name for behavior in self.active))

    def suspend(self, why: str) -> bool:
        """Have the behavior that moves the vehicle stop along its line and wait; False where none does.

        Its work begins again, where the vehicle is then, with `resume`. Taking off and landing are the autopilot's own
        and aren't suspended.
        """
        return self._each_moving("suspended", why, Activation.suspend)

    def resume(self, why: str) -> bool:
        """Go on after `suspend`."""
        return self._each_moving("resumed", why, Activation.resume)

    def _each_moving(self, what: str, why: str, do: Callable[[Activation], None]) -> bool:
        flying = frozenset({Phase.FLYING})
        moving = [a for a in self._active if not a.done and a.behavior.moves and a.behavior.phases == flying]
        for activation in moving:
            do(activation)
            text = f"{activation.behavior.name} {what}: {why}"
            self._context.bus.event.publish(Event(self._context.now(), "behavior", text))
        return bool(moving)

    def _same(self, behavior: AnyBehavior) -> Activation | None:
        for activation in self._active:
            other = activation.behavior
            if type(other) is type(behavior) and other.parameters == behavior.parameters and not activation.done:
                return activation
        return None

    async def _make_way(self, behavior: AnyBehavior) -> Result | None:
        """Stop what ``behavior`` can't be beside and activate what it needs; how it is refused, None where it isn't."""
        if (refused := await self._stop_lower(behavior)) is not None:
            return refused
        if self._context.machine.phase not in behavior.phases:
            for name in behavior.needs:
                needed = find("behaviors", name)(self._context)
                if needed.refusal():
                    break
                if not (result := await self.run(needed)).achieved:
                    return Result(result.outcome, f"it needs {name}, which ended: {result.reason}")
        elif behavior.missing():
            await self._wait_for_inputs(behavior)
        if (refused := await self._stop_lower(behavior)) is not None:  # others may have begun meanwhile
            return refused
        if self._over:
            return Result(Outcome.INTERRUPTED, "refused: the mission is over")
        if refusal := behavior.refusal():
            return Result(Outcome.PROCESS_FAILURE, refusal)
        return None

    async def _wait_for_inputs(self, behavior: AnyBehavior) -> None:
        """Give what is missing a moment to come: after a stall of the process it is on its way."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(INPUT_PATIENCE):
                while behavior.missing():
                    await self._context.bus.state.next()

    async def _stop_lower(self, behavior: AnyBehavior) -> Result | None:
        while conflicts := [a for a in self._active if not a.done and _conflict(a.behavior, behavior)]:
            strongest = max(conflicts, key=lambda a: a.behavior.priority)
            if strongest.behavior.priority >= behavior.priority:
                return Result(Outcome.PROCESS_FAILURE, f"refused: {strongest.behavior.name} is active")
            for activation in conflicts:
                await activation.stop(f"{behavior.name} has taken over")
        return None

    def _tell(self, behavior: AnyBehavior, result: Result) -> None:
        text = f"{behavior.name}: {result.outcome}: {result.reason}"
        self._context.bus.event.publish(Event(self._context.now(), "behavior", text))


def _conflict(one: AnyBehavior, other: AnyBehavior) -> bool:
    return (one.moves and other.moves) or one.name in other.excludes or other.name in one.excludes


async def _ended(task: "asyncio.Task[Result]") -> None:
    """Cancel ``task`` and wait for its end, whatever it says."""
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
