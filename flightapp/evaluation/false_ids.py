"""How often a detector sees markers where there are none, in pictures of `decoys`."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from flightapp.config import Config
from flightapp.evaluation.decoys import IDS, SHAPE, decoy_picture
from flightapp.interfaces import Detector
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector
from flightapp.track import Gate, GateShape, MarkerLayout, Start, Track

FIRST_SEED = 1_000_000
AT_ONCE = 5_000
"""Pictures between two reports."""
MARGIN = 20.0
"""px about a decoy in which it is sought, as the map's predictions are."""


@dataclass(frozen=True, slots=True)
class FalseId:
    """A marker seen where there is none."""

    seed: int
    tracking: bool
    marker_id: int
    quality: float


def false_ids(detector: Detector, seeds: Iterable[int]) -> list[FalseId]:
    """What ``detector`` sees in a picture without markers for each of ``seeds``.

    Each is searched as a whole, and in boxes about its decoys, or its middle where it has none.
    """
    seen: list[FalseId] = []
    around = np.array((-MARGIN, -MARGIN, MARGIN, MARGIN))
    for seed in seeds:
        image, decoys = decoy_picture(np.random.default_rng(seed))
        frame = Frame(0.0, 0, image)
        middle = np.array((SHAPE[1], SHAPE[0], 3.0 * SHAPE[1], 3.0 * SHAPE[0])) / 4.0
        boxes = [box + around for box in decoys] or [middle]
        for tracking in (False, True):
            found = detector.detect(frame, boxes if tracking else None)
            seen += [FalseId(seed, tracking, marker.marker_id, marker.quality) for marker in found]
    return seen


def knows_all_ids() -> Track:
    """A track whose gates carry all markers of `decoys.IDS`, so that every one counts as known."""
    gates = tuple(
        Gate(id=n, position=(3.0 * n, 0.0, 2.0), yaw_deg=0.0, markers=(marker,)) for n, marker in enumerate(IDS)
    )
    return Track(
        name="all", start=Start(position=(0.0, 0.0, 0.0)), gate=GateShape(layout=MarkerLayout.TOP), gates=gates
    )


def run_false_ids(pictures: int, first_seed: int = FIRST_SEED) -> Iterator[dict[str, Any]]:
    """The result of `flightapp bench --false-ids` so far, each `AT_ONCE` pictures, for our own detector.

    A run that was broken off is resumed with the seed after the last one that it told.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        detector, seen = ArucoDetector(Config(), knows_all_ids()), list[FalseId]()
        for begin in range(0, pictures, AT_ONCE):
            end = min(begin + AT_ONCE, pictures)
            seen += false_ids(detector, range(first_seed + begin, first_seed + end))
            found = [{"seed": s.seed, "tracking": s.tracking, "id": s.marker_id, "quality": s.quality} for s in seen]
            yield {"pictures": end, "first_seed": first_seed, "last_seed": first_seed + end - 1, "false": found}
    finally:
        cv2.setNumThreads(threads)


def false_ids_line(result: dict[str, Any]) -> str:
    """``result`` in a line, and each false id in one more."""
    seeds = f"seeds {result['first_seed']} to {result['last_seed']}"
    lines = [f"{len(result['false'])} false ids in {result['pictures']} pictures, each searched twice ({seeds})"]
    for found in result["false"]:
        way = "tracking" if found["tracking"] else "acquisition"
        lines.append(f"  seed {found['seed']}, {way}: id {found['id']}, quality {found['quality']:.2f}")
    return "\n".join(lines)
