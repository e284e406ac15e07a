"""Calibrating a camera from images of a board, live or recorded, and telling what was found."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from flightapp.calibration.board import Board, BoardFinder, View
from flightapp.calibration.coverage import Coverage, shortfalls
from flightapp.calibration.intrinsics import Calibration, calibrate
from flightapp.calibration.lens_guess import guess, ideal
from flightapp.cameras.live import first_shot
from flightapp.cameras.names import parse_source
from flightapp.cameras.opencv import OpencvDevice
from flightapp.cameras.recordings import recorded_frames
from flightapp.cameras.shots import CameraError, DamagedImageError
from flightapp.config import Camera
from flightapp.inputs import BadInputError
from flightapp.messages import Frame
from flightapp.perception.camera import CameraModel, Lens

TELL_EVERY = 2.0
"""s between lines of guidance while a live camera films."""
STEADY = 2.0
"""px by which corners may move from one live image to the next: else they are blurred."""
LEAST_VIEWS = 4
REGUESS = (3, 8, 20)
"""Views after which the lens is guessed anew, for the guidance."""
LATER = 50
"""Views of the board that the guessed lens does not explain, and that are kept until the next guess."""
WORST = 10
"""Images that are listed."""

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class CameraFound:
    """A calibration, and whether it is to be relied on."""

    found: Calibration
    shortfalls: tuple[str, ...]
    images: int
    """That were looked at."""
    seen: int
    """That showed the board."""


def calibrate_camera(source: str, camera: Camera, lens: Lens, board: Board, seconds: float, tell: Tell) -> CameraFound:
    """The camera of ``source`` from its images of ``board``; of a live one for at most ``seconds``.

    Raises `BadInputError` where nothing can be told at all.
    """
    parsed = parse_source(source)
    chooser = Chooser(board, lens)
    if parsed.kind.live:
        with _filming(OpencvDevice(parsed, camera), tell) as frames:
            _guide(chooser, frames, seconds, tell)
    else:
        for frame in recorded_frames(parsed, camera.rate):
            chooser.look(frame)
    tell(chooser.told())
    return chooser.solve()


class Chooser:
    """Looks at images, and keeps the views of the board that tell something new."""

    def __init__(self, board: Board, lens: Lens) -> None:
        self._board, self._lens, self._finder = board, lens, BoardFinder(board)
        self._views: list[View] = []
        self._later: deque[View] = deque(maxlen=LATER)
        self._coverage: Coverage | None = None
        self._before: View | None = None
        self._size = (0, 0)
        self.images = self.seen = 0

    @property
    def done(self) -> bool:
        """Whether nothing is missing any more."""
        return self._coverage is not None and not self._coverage.missing()

    def look(self, frame: Frame, steady: float = np.inf) -> View | None:
        """The board in ``frame``, kept if it is new and moves by less than ``steady`` px since the last one."""
        if frame.image is None:
            return None
        height, width = frame.image.shape[:2]
        if self._size not in ((0, 0), (width, height)):
            raise BadInputError(f"image {self.images + 1} has {width} × {height} px, those before {self._size}")
        self._size = width, height
        self.images += 1
        view = self._finder.find(frame.image, f"image {frame.sequence + 1}", frame.stamp)
        before, self._before = self._before, view
        if view is None:
            return None
        self.seen += 1
        if _moved(before, view) > steady:
            return view
        if self._coverage is None:
            self._coverage = Coverage(self._board, ideal(self._lens, width, height, 0.5 * width))
        if self._coverage.take(view):
            self._views.append(view)
            if len(self._views) in REGUESS:
                self._reguess()
        elif not self._coverage.explains(view):
            self._later.append(view)
        return view

    def told(self) -> str:
        """How far it is, in one line."""
        if self._coverage is None:
            return f"no board in {self.images} images yet: show {self._board}"
        return self._coverage.told()

    def solve(self) -> CameraFound:
        """The calibration of what was kept; raises `BadInputError`."""
        if self._coverage is not None and len(self._views) >= LEAST_VIEWS:
            self._reguess()
        if len(self._views) < LEAST_VIEWS:
            raise BadInputError(
                f"the board was seen in {self.seen} of {self.images} images, in {len(self._views)} that differ;"
                f" at least {LEAST_VIEWS} are needed: is it {self._board}? (--dictionary, --columns, --rows)"
            )
        found = calibrate(self._lens, *self._size, self._board.corners, self._views)
        if found is None:
            raise BadInputError(
                f"no {self._lens} lens explains what was seen; try the other kind (--lens), and check --columns,"
                " --rows, --square and --marker against the board"
            )
        return CameraFound(found, shortfalls(self._board, found), self.images, self.seen)

    def _reguess(self) -> None:
        """Judge the views by a lens that fits them better."""
        model = guess(self._lens, *self._size, self._board.corners, self._views)
        coverage = Coverage(self._board, model)
        waiting, self._later = (*self._views, *self._later), deque(maxlen=LATER)
        self._views = [view for view in waiting if coverage.take(view)]
        self._later.extend(view for view in waiting if not coverage.explains(view))
        self._coverage = coverage


def _moved(before: View | None, view: View) -> float:
    """px, median by which corners that both show have moved; infinite where there are none."""
    if before is None:
        return np.inf
    _, a, b = np.intersect1d(before.ids, view.ids, return_indices=True)
    if not len(a):
        return np.inf
    return float(np.median(np.linalg.norm(before.pixels[a] - view.pixels[b], axis=1)))


@contextmanager
def _filming(device: OpencvDevice, tell: Tell) -> Iterator[Iterator[Frame]]:
    """The frames of a live camera while it is there; raises `BadInputError`."""
    try:
        for text in device.open():
            tell(text)
        first = first_shot(device)
    except CameraError as error:
        device.close()
        raise BadInputError(str(error)) from None

    def frames() -> Iterator[Frame]:
        yield Frame(first.stamp, 0, first.image)
        count = 0
        while True:
            try:
                shot = device.read()
            except DamagedImageError:
                continue
            except CameraError as error:
                tell(f"{error}: what was seen so far is used")
                return
            count += 1
            yield Frame(shot.stamp, count, shot.image)

    try:
        yield frames()
    finally:
        device.close()


def _guide(chooser: Chooser, frames: Iterator[Frame], seconds: float, tell: Tell) -> None:
    """Look at live ``frames`` until nothing is missing, the time is over, or ^C; say what is wanted meanwhile."""
    begun = told = time.monotonic()
    try:
        for frame in frames:
            view = chooser.look(frame, STEADY)
            now = time.monotonic()
            if chooser.done or now - begun > seconds:
                return
            if now - told > TELL_EVERY:
                told = now
                tell(chooser.told() if view is not None else f"no board in sight; {chooser.told()}")
    except KeyboardInterrupt:
        tell("ended by hand: what was seen so far is used")


def camera_json(result: CameraFound) -> dict[str, Any]:
    """``result`` for other programs."""
    found = result.found
    return {
        "lens": found.model.lens.value,
        "width": found.model.width,
        "height": found.model.height,
        "focal": found.model.focal.tolist(),
        "distortion": found.model.distortion.tolist(),
        "deviation": found.deviation.tolist(),
        "rms": found.rms,
        "images": result.images,
        "seen": result.seen,
        "views": [
            {"image": view.name, "corners": len(view.ids), "rms": float(error)}
            for view, error in zip(found.views, found.errors, strict=True)
        ],
        "rejected": [{"image": name, "rms": error} for name, error in found.rejected],
        "shortfalls": list(result.shortfalls),
    }


def camera_tables(result: CameraFound) -> tuple[Table, Table]:
    """The lens with its standard deviations, and the images that fit worst."""
    found = result.found
    lens = Table(title=f"{found.model.lens.value} camera, {found.model.width} × {found.model.height} px")
    for heading in ("", "value", "standard deviation"):
        lens.add_column(heading, justify="right")
    for name, value, deviation in zip(_names(found.model), _values(found.model), found.deviation, strict=True):
        digits = 2 if name.endswith("px") else 5
        lens.add_row(name, f"{value:.{digits}f}", f"{deviation:.{digits}f}")
    images = Table(title=f"reprojection error, {found.rms:.3f} px RMS over {len(found.views)} images")
    for heading in ("image", "corners", "RMS px", ""):
        images.add_column(heading, justify="right")
    for name, error in found.rejected:
        images.add_row(name, "", f"{error:.3f}", "left out: it does not fit the others")
    for i in np.argsort(-found.errors)[:WORST]:
        images.add_row(found.views[i].name, f"{len(found.views[i].ids)}", f"{found.errors[i]:.3f}", "")
    return lens, images


def _names(model: CameraModel) -> Sequence[str]:
    coefficients = ("k1", "k2", "k3", "k4") if model.fisheye else ("k1", "k2", "p1", "p2")
    return ("fx px", "fy px", "cx px", "cy px", *coefficients)


def _values(model: CameraModel) -> Sequence[float]:
    return [float(value) for value in np.concatenate((model.focal, model.distortion))]
