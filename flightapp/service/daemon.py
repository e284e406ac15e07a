"""The service: waits for missions and flies one at a time, as `flightapp fly` does, in the main thread's event loop.

Nothing flies by itself: after its start, also after a crash, it waits for a mission that somebody asks for.
"""

import gc
import queue
import signal
import threading
from concurrent.futures import Future
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from flightapp import app, results
from flightapp.bus import Bus
from flightapp.config import Config
from flightapp.evaluation.summary import why_failed
from flightapp.inputs import BadInputError
from flightapp.interfaces import Rig
from flightapp.messages import Event, Outcome
from flightapp.mission.loader import MissionFile
from flightapp.mission.orders import NOTHING_FLIES, Orders
from flightapp.service.files import allowed_file
from flightapp.service.journal import ERROR, NOTICE, Journal
from flightapp.service.notify import Notifier
from flightapp.service.peer import Peer
from flightapp.service.picture import Picture
from flightapp.service.protocol import Abort, Reload, Request, Start, Status, Stop, Tunables, Tune
from flightapp.service.pulse import Pulse
from flightapp.service.server import Answer, ControlServer

LOOK = 0.2
"""s between looks of the waiting service at what it is asked for."""
WAITING = "waiting for a mission"
STOPS = {signal.SIGINT, signal.SIGTERM}


class State(StrEnum):
    """What the service is at."""

    IDLE = "idle"
    PREPARING = "preparing"
    FLYING = "flying"
    FINISHING = "finishing"


@dataclass(frozen=True, slots=True)
class ServiceOptions:
    """What the command line asks for."""

    socket: Path
    rig: str
    places: tuple[Path, ...]
    """Directories from which missions and vehicle files may come."""
    runs: Path
    vehicle: Path | None = None
    """Where a start names none."""
    settings: tuple[str, ...] = ()
    """Before those of a start."""
    realtime: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """A flight that was asked for."""

    plan: app.FlightPlan
    accepted: Future[dict[str, Any]] = field(default_factory=Future)
    orders: Orders = field(default_factory=Orders)


class Service:
    """One service, from `run` to its end. ``notifier`` is systemd."""

    def __init__(self, options: ServiceOptions, notifier: Notifier, journal: Journal) -> None:
        self._options, self._notifier, self._journal = options, notifier, journal
        self._pulse = Pulse(notifier.ping, notifier.watchdog)
        self._jobs: queue.SimpleQueue[_Job] = queue.SimpleQueue()
        self._job: _Job | None = None
        self._state = State.IDLE
        self._picture: Picture | None = None
        self._last: dict[str, Any] | None = None
        self._stopping = ""
        self._up = False
        self._turns = -1
        self._lock = threading.Lock()

    def run(self) -> None:
        """Serve until SIGTERM or SIGINT; a flight under way lands first. In the main thread."""
        handlers = dict.fromkeys(STOPS, self._stop) | {signal.SIGHUP: self._hangup}
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            self._serve()
        except SystemExit:
            pass
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            self._journal.write(self._stopping or "the service failed")

    def _serve(self) -> None:
        server = ControlServer(self._options.socket, self.answer, self._turn)
        try:
            self._up = True
            self._notifier.ready(WAITING)
            self._journal.write(f"listening at {self._options.socket}")
            while (job := self._next(server)) is not None:
                self._fly(job)
        finally:
            server.close()

    # Signals, in the main thread.

    def _stop(self, number: int, _: object) -> None:
        """End: at once, or after the landing and its record where there is a flight. Later ones change nothing."""
        again, self._stopping = bool(self._stopping), f"ended by {signal.Signals(number).name}"
        if again:
            return
        self._notifier.stopping()
        job = self._job
        if job is not None and job.orders.begun:
            job.orders.stop(f"interrupted by {signal.Signals(number).name}")
        elif self._up:
            raise SystemExit  # out of whatever is being waited for, loaded or compiled

    def _hangup(self, *_: object) -> None:
        """Read the files of the flight anew; without one they are read at the next start anyway."""
        self._notifier.reloading()
        self._retune(None, "SIGHUP").add_done_callback(lambda _: self._notifier.ready(self._line()))

    def _retune(self, settings: dict[str, str] | None, who: str) -> Future[str]:
        job = self._job
        wanted = "its files" if settings is None else ", ".join(f"{key}={value}" for key, value in settings.items())
        self._journal.write(f"tuning with {wanted} asked for by {who}" + ("" if job is not None else "; nothing flies"))
        return (Orders() if job is None else job.orders).retune(settings)

    # Flights, in the main thread.

    def _next(self, server: ControlServer) -> _Job | None:
        """The next that is asked for, None at the end.

        Meanwhile the watchdog is told of this loop's health and the server's. What a signal raises is lost where it
        comes amid a destructor, so the end is looked for here, too.
        """
        while not self._stopping:
            try:
                return self._jobs.get(timeout=LOOK)
            except queue.Empty:
                if server.turns != self._turns:
                    self._turns = server.turns
                    self._pulse.beat()
        return None

    def _fly(self, job: _Job) -> None:
        last, why = self._last, "the service is about to end"
        try:
            prepared = app.prepare(job.plan)
            mission, config = prepared
            job.accepted.set_result({"ok": True, "run": str(job.plan.out)})
            self._journal.write(f"{mission.name}: preparing to fly; the record goes to {job.plan.out}")
            flown = app.fly_prepared(
                job.plan, prepared, lambda bus, rig: self._watch(job, mission, config, bus, rig), job.orders
            )
            self._state = State.FINISHING
            self._pulse.rest()
            last = self._finish(flown)
        except BadInputError as error:
            why = str(error)
            self._journal.write(f"{job.plan.mission.stem}: {why}", ERROR)
            if job.accepted.done():
                last = _ended(job.plan.mission.stem, job.plan.out, Outcome.PROCESS_FAILURE, why, why)
        finally:
            self._pulse.rest()
            with self._lock:
                self._job, self._picture, self._state, self._last = None, None, State.IDLE, last
            gc.collect()  # what the flight has left, of which the collector, which it stops, knows nothing
            # Told last: whoever hears it may ask for the next.
            if not job.accepted.done():
                job.accepted.set_exception(BadInputError(why))

    def _watch(self, job: _Job, mission: MissionFile, config: Config, bus: Bus, rig: Rig) -> None:
        picture = Picture(mission, config, bus, rig)

        def tick(stamp: float) -> None:
            picture.begin(stamp)
            self._pulse.tick()

        bus.tick.tap(tick)
        bus.event.tap(self._tell)
        self._picture, self._state = picture, State.FLYING
        self._pulse.fly(config.control.rate)

    def _tell(self, event: Event) -> None:
        self._journal.write(f"{event.stamp:.2f} s  {event.text}", ERROR if event.kind == "fault" else NOTICE)

    def _finish(self, flown: app.Flown) -> dict[str, Any]:
        """The flight's summary and, unless the service is to end, its report; how it ended."""
        outcome, reason = flown.ending.outcome, flown.ending.reason
        try:
            failed = why_failed(results.finish(flown, page=not self._stopping))
        except (BadInputError, OSError) as error:
            self._journal.write(f"{flown.out}: no report: {error}", ERROR)
            failed = flown.log_error or str(error)
        self._journal.write(f"{flown.mission}: {outcome}: {reason}")
        return _ended(flown.mission, flown.out, outcome, reason, failed)

    # Requests, in the server's thread.

    def answer(self, request: Request, peer: Peer) -> Answer:
        """What becomes of ``request``; raises `BadInputError` for what is refused."""
        match request:
            case Status():
                return self.status()
            case Start():
                return self._start(request, peer)
            case Stop() | Abort():
                return self._end(request, peer)
            case Tune(settings=settings):
                return _answered(self._retune(settings, str(peer)))
            case Reload():
                return _answered(self._retune(None, str(peer)))
            case Tunables():
                return self._tunables()

    def status(self) -> dict[str, Any]:
        """What the service does and how its last flight ended."""
        with self._lock:
            job, picture, state, last = self._job, self._picture, self._state, self._last
        flight = None if job is None else {"mission": job.plan.mission.stem, "run": str(job.plan.out)}
        if flight is not None and picture is not None:
            flight |= picture.status()
        stopping = self._stopping or (job.orders.stopped if job is not None else "")
        return {"ok": True, "state": str(state), "flight": flight, "last": last, "stopping": stopping}

    def _start(self, request: Start, peer: Peer) -> Answer:
        options = self._options
        mission = allowed_file(request.mission, options.places, "mission")
        vehicle = options.vehicle
        if request.vehicle is not None:
            vehicle = allowed_file(request.vehicle, options.places, "vehicle file")
        with self._lock:
            if self._stopping:
                raise BadInputError("the service is about to end; start it again first")
            if self._job is not None:
                now = f"{self._job.plan.mission.stem} is {self._state}"
                raise BadInputError(f"one flight at a time: {now}; wait for its end, or `flightapp stop`")
            out = results.new_directory(f"{mission.stem}-{request.seed}", options.runs)
            overrides = (*options.settings, *request.settings)
            plan = app.FlightPlan(mission, out, options.rig, vehicle, overrides, request.seed, options.realtime)
            self._job = _Job(plan)
            self._state = State.PREPARING
        self._journal.write(f"{mission.stem}: start asked for by {peer}")
        self._jobs.put(self._job)
        return self._job.accepted

    def _end(self, request: Stop | Abort, peer: Peer) -> Answer:
        job = self._job
        if job is None or self._state is State.FINISHING:
            raise BadInputError("nothing flies")
        why = f"{request.do} asked for by {peer}"
        self._journal.write(why)
        (job.orders.abort if isinstance(request, Abort) else job.orders.stop)(why)
        return {"ok": True, "text": "it lands" if job.orders.begun else "it will not take off"}

    def _tunables(self) -> Answer:
        if (picture := self._picture) is None:
            raise BadInputError(NOTHING_FLIES)
        return {"ok": True, "fields": picture.tunables()}

    def _turn(self) -> None:
        """Now and then: what the service does, and that it is well where only the server's thread can tell."""
        job = self._job
        if self._state is State.FLYING and job is not None and job.orders.begun and not job.orders.flying:
            self._state = State.FINISHING
            self._pulse.rest()
        if self._state in (State.PREPARING, State.FINISHING):
            self._pulse.beat()
        self._notifier.status(self._line())

    def _line(self) -> str:
        job, picture, last = self._job, self._picture, self._last
        if job is None:
            return WAITING if last is None else f"{WAITING}; {last['mission']} ended: {last['outcome']}"
        if picture is None or self._state is not State.FLYING:
            return f"{job.plan.mission.stem}: {self._state}"
        return picture.line() + (f"; {job.orders.stopped}" if job.orders.stopped else "")


def _answered(asked: Future[str]) -> Future[dict[str, Any]]:
    """The answer to a client, once there is one to what was ``asked`` of the flight."""
    answer: Future[dict[str, Any]] = Future()

    def done(future: Future[str]) -> None:
        error = future.exception()
        if error is not None:
            answer.set_exception(error)
        else:
            answer.set_result({"ok": True, "text": future.result()})

    asked.add_done_callback(done)
    return answer


def _ended(mission: str, out: Path, outcome: str, reason: str, failed: str) -> dict[str, Any]:
    """How a flight ended; ``failed`` says why it does not count as a success, empty where it does."""
    return {"mission": mission, "run": str(out), "outcome": str(outcome), "reason": reason, "failed": failed}
