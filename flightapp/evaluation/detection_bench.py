"""Detectors side by side on the same pictures: time, share of markers found, corner error, false ids.

Pictures are of `detection_images`. In tracking each detector is given boxes about where the markers are, as far off
as a map is, in acquisition the whole image.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from flightapp.config import Camera, Config
from flightapp.evaluation.detection_images import Conditions, Picture, draw_picture, marker_texture
from flightapp.frames import Vector
from flightapp.interfaces import Detector
from flightapp.messages import Frame
from flightapp.perception.aruco import ArucoDetector
from flightapp.perception.camera import CameraModel, Lens
from flightapp.perception.opencv import OpencvDetector
from flightapp.track import Gate, GateShape, Start, Track

SIZES = (70.0, 50.0, 35.0, 25.0, 15.0)
BLURS = (0.0, 2.0, 4.0, 6.0)
IDS = (0, 1, 2, 3)
FIRST_SEED = 21000
PREDICTION = 8.0
"""px by which predictions are off at most, each way."""
NEAR = 0.1
"""Of its size, and at least 3 px: corners further off than this are no corners of the marker."""
PERCENTILES = (50.0, 99.0)


def bench_cameras() -> dict[str, CameraModel]:
    """A pinhole of 640×480 with the distortion of a cheap lens, and a fisheye about as a T265's of 848×800."""
    fisheye = {"width": 848, "height": 800, "focal": (286.0, 286.0, 424.0, 400.0)}
    return {
        "pinhole": Camera(width=640, height=480, distortion=(-0.25, 0.06, 0.001, -0.0005)).model(),
        "fisheye": Camera(lens=Lens.FISHEYE, distortion=(-0.008, 0.04, -0.037, 0.006), **fisheye).model(),
    }


@dataclass(slots=True)
class Score:
    """What one detector did in some pictures."""

    seconds: list[float] = field(default_factory=list)
    markers: int = 0
    found: int = 0
    false: int = 0
    """Ids that are not in the picture, or elsewhere."""
    squares: list[float] = field(default_factory=list)
    """px², of each corner."""

    def add(self, other: "Score") -> None:
        """Take over what ``other`` has."""
        self.seconds += other.seconds
        self.squares += other.squares
        self.markers, self.found = self.markers + other.markers, self.found + other.found
        self.false += other.false

    def as_row(self) -> dict[str, Any]:
        """s, shares and px."""
        p50, p99 = np.percentile(self.seconds, PERCENTILES)
        rms = float(np.sqrt(np.mean(self.squares))) if self.squares else None
        share = self.found / self.markers if self.markers else None
        return {"p50": float(p50), "p99": float(p99), "found": share, "corner_rms": rms, "false": self.false}


def run_detection_bench(pictures: int = 6, first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Both detectors over cameras, sizes and blurs, ``pictures`` of each; the result of `flightapp bench --detection`.

    OpenCV runs in one thread meanwhile.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rows = list(_rows(pictures, first_seed))
    finally:
        cv2.setNumThreads(threads)
    return {"pictures_per_row": pictures, "first_seed": first_seed, "rows": rows}


def detection_table(result: dict[str, Any]) -> Table:
    """``result`` for a terminal: for each way of detecting ms p50 / p99, % found, px RMS of corners."""
    names = list(result["rows"][0]["detectors"])
    table = Table("camera", "size", "blur", *names, title="ms p50 / p99 · found · corner error px RMS · false ids")
    for row in result["rows"]:
        whole = row["size"] is None
        sizes = ("all", "all") if whole else (f"{row['size']:g}", f"{row['blur']:g}")
        cells = [_cell(row["detectors"][name]) for name in names]
        table.add_row(row["camera"], *sizes, *cells, end_section=whole)
    return table


def bench_track(ids: Sequence[int] = IDS, dictionary: str = "4X4_50") -> Track:
    """A gate of the markers ``ids``, four."""
    gate = Gate(id=0, position=(5.0, 0.0, 1.5), yaw_deg=0.0, markers=tuple(ids))
    shape = GateShape(dictionary=dictionary)
    return Track(name="detection", start=Start(position=(0.0, 0.0, 0.0)), gate=shape, gates=(gate,))


def judge(
    detector: Detector, picture: Picture, size: float, regions: Sequence[Vector] | None, repeats: int = 2
) -> Score:
    """Have ``detector`` search ``picture``, whose markers are of ``size`` px; the least time of ``repeats`` counts."""
    frame, least = Frame(0.0, 0, picture.image), np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        markers = detector.detect(frame, regions)
        least = min(least, time.perf_counter() - begin)
    score = Score(seconds=[float(least)], markers=len(picture.corners))
    for marker in markers:
        truth = picture.corners.get(marker.marker_id)
        squares = [np.inf] if truth is None else ((marker.corners - truth) ** 2).sum(axis=1).tolist()
        if max(squares) > max(NEAR * size, 3.0) ** 2:
            score.false += 1
            continue
        score.found += 1
        score.squares += squares
    return score


def predicted_regions(picture: Picture, margin: float, generator: np.random.Generator) -> list[Vector]:
    """Boxes with ``margin`` px about where the markers of ``picture`` are thought to be."""
    off = generator.uniform(-PREDICTION, PREDICTION, (len(picture.corners), 2))
    return [
        np.concatenate((corners.min(axis=0) + d - margin, corners.max(axis=0) + d + margin))
        for corners, d in zip(picture.corners.values(), off, strict=True)
    ]


def _rows(pictures: int, first_seed: int) -> Iterator[dict[str, Any]]:
    config, track = Config(), bench_track()
    ours, theirs = ArucoDetector(config, track), OpencvDetector(config, track)
    ways: dict[str, tuple[Detector, bool]] = {
        "aruco_tracking": (ours, True),
        "aruco_full": (ours, False),
        "opencv_tracking": (theirs, True),
        "opencv_full": (theirs, False),
    }
    textures = {n: marker_texture(cv2.aruco.DICT_4X4_50, n) for n in IDS}
    for name, camera in bench_cameras().items():
        total = {way: Score() for way in ways}
        for size in SIZES:
            for blur in BLURS:
                scores = {way: Score() for way in ways}
                for seed in range(first_seed, first_seed + pictures):
                    generator = np.random.default_rng((seed, int(size), int(blur)))
                    conditions = Conditions(
                        size=size, blur=blur, brightness=generator.uniform(0.3, 1.0), rim=generator.uniform(0.7, 1.0)
                    )
                    picture = draw_picture(camera, textures, conditions, generator)
                    regions = predicted_regions(picture, config.detection.region_margin, generator)
                    for way, (detector, tracking) in ways.items():
                        scores[way].add(judge(detector, picture, size, regions if tracking else None))
                for way, score in scores.items():
                    total[way].add(score)
                yield _row(name, size, blur, scores)
        yield _row(name, None, None, total)


def _row(camera: str, size: float | None, blur: float | None, scores: dict[str, Score]) -> dict[str, Any]:
    detectors = {way: score.as_row() for way, score in scores.items()}
    return {"camera": camera, "size": size, "blur": blur, "detectors": detectors}


def _cell(row: dict[str, Any]) -> str:
    error = "–" if row["corner_rms"] is None else f"{row['corner_rms']:.2f}"
    return f"{1e3 * row['p50']:.2f} / {1e3 * row['p99']:.2f} · {row['found']:.0%} · {error} · {row['false']}"
