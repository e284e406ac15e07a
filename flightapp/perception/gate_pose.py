"""The pose of a gate from all of its visible markers together.

`planar` gives two candidate poses and `refinement` minimises the reprojection error of each. A plane seen nearly
face on, or small, leaves both poses likely: the less likely one is handed on as the alternative unless a
likelihood ratio rules it out.
"""

import math
from collections.abc import Sequence

import numpy as np

from flightapp.config import Config
from flightapp.frames import Vector, quat_from_matrix
from flightapp.jit import assign, kernel
from flightapp.linear import factor, substitute
from flightapp.messages import GateSighting, MarkerDetection
from flightapp.perception.camera import CameraModel
from flightapp.perception.planar import gate_candidates
from flightapp.perception.refinement import corner_weights, refine_pose
from flightapp.track import Track

LIKELIHOOD_RATIO = 9.0
"""The alternative is dropped when its squared error, over the noise's variance, is larger by this (3 sigma)."""

PRIOR_WEIGHT = 8.0
"""The expected corner noise counts as much as so many residuals: those of a marker."""

SAME_POSE = 1e-2
"""rad and fraction of the distance: candidates this close have met in one minimum."""

SUSPECT = 3.0
"""RMS reprojection over the corner noise from which one of several markers is suspected to be wrong."""

IMPROVEMENT = 0.5
"""Leaving a marker out must reduce the RMS reprojection to this fraction to be believed."""

# A fit: R_cg row by row, p_cg, JᵀJ (6, 6) row by row, sum of squared errors in px².
_POSITION, _INFORMATION, _SQUARES = 9, 12, 48
_FIT = 49
# A sighting: position, orientation, covariance, then position and orientation of the alternative.
_SIGHTING = 50


@kernel
def _fit(points: Vector, rays: Vector, weights: Vector, fits: Vector) -> int:
    """Poses from which the markers' face can be seen, refined, the best first, into ``fits`` (2, 49); how many."""
    for i in range(weights.shape[0]):
        for j in range(2):
            if not math.isfinite(weights[i, j, 0] + weights[i, j, 1] + weights[i, j, 2]):
                return 0
    R, p, H = np.empty((2, 3, 3)), np.empty((2, 3)), np.empty((6, 6))
    count = 0
    for m in range(gate_candidates(points, rays, R, p)):
        squares = refine_pose(R[m], p[m], points, rays, weights, H)
        ahead = R[m, 0, 0] * p[m, 0] + R[m, 1, 0] * p[m, 1] + R[m, 2, 0] * p[m, 2]
        if not (math.isfinite(squares) and ahead > 0.0):
            continue
        row = fits[count]
        if count == 1 and squares < fits[0, _SQUARES]:
            assign(fits[1], fits[0])
            row = fits[0]
        for i in range(3):
            row[_POSITION + i] = p[m, i]
            for j in range(3):
                row[3 * i + j] = R[m, i, j]
        for i in range(6):
            for j in range(6):
                row[_INFORMATION + 6 * i + j] = H[i, j]
        row[_SQUARES] = squares
        count += 1
    return count


@kernel
def _credible(fit: Vector, corners: int, limits: Vector) -> bool:
    near = fit[9] ** 2 + fit[10] ** 2 + fit[11] ** 2 <= limits[2] ** 2
    return bool(near and fit[_SQUARES] <= limits[1] ** 2 * corners)


@kernel
def _another(best: Vector, other: Vector) -> bool:
    """Whether two fits are two poses, not one minimum reached twice."""
    trace = moved2 = distance2 = 0.0
    for i in range(9):
        trace += best[i] * other[i]
    for i in range(_POSITION, _INFORMATION):
        moved2 += (other[i] - best[i]) ** 2
        distance2 += best[i] ** 2
    turned = math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
    return bool(turned > SAME_POSE or moved2 > SAME_POSE**2 * distance2)


@kernel
def _in_body(fit: Vector, R_bc: Vector, p_bc: Vector, out: Vector) -> None:
    """Position and orientation of the gate in the body frame into ``out`` (7,)."""
    R = np.empty((3, 3))
    for i in range(3):
        out[i] = p_bc[i]
        for j in range(3):
            out[i] += R_bc[i, j] * fit[_POSITION + j]
            R[i, j] = R_bc[i, 0] * fit[j] + R_bc[i, 1] * fit[3 + j] + R_bc[i, 2] * fit[6 + j]
    assign(out[3:7], quat_from_matrix(R))


@kernel
def _corner_variance(fit: Vector, corners: int, noise: float) -> float:
    """px², of the ``corners`` of a fit: what its residuals tell, together with the ``noise`` expected beforehand.

    The scale of the scaled inverse χ² that is the variance's posterior (A. Gelman et al., "Bayesian Data Analysis",
    2013, section 2.6): blurred corners scatter more than sharp ones, and four markers tell by how much. That the
    variance is uncertain raises the mean of the normalised squared errors, by one in the divisor.
    """
    free = 2 * corners - 6
    variance: float = (PRIOR_WEIGHT * noise * noise + fit[_SQUARES]) / (PRIOR_WEIGHT + free - 1.0)
    return variance


@kernel
def _covariance(fit: Vector, variance: float, R_bc: Vector, out: Vector) -> bool:
    """Covariance (36,) of a fit in the axes of a sighting; False where the corners leave the pose open.

    ``variance`` is that of a corner, px².
    """
    A, column = np.empty((6, 6)), np.empty(6)
    for i in range(6):
        for j in range(6):
            A[i, j] = fit[_INFORMATION + 6 * i + j]
    if not factor(A):
        return False
    # with the information J and the axes T, the covariance T J⁻¹ Tᵀ has the rows T J⁻¹ (row of T)
    for i in range(6):
        for k in range(3):
            column[k] = R_bc[i, k] if i < 3 else 0.0
            column[3 + k] = 1.0 if i == 3 + k else 0.0
        substitute(A, column)
        for k in range(3):
            turned = R_bc[k, 0] * column[0] + R_bc[k, 1] * column[1] + R_bc[k, 2] * column[2]
            out[6 * i + k] = variance * turned
            out[6 * i + 3 + k] = variance * column[3 + k]
    for i in range(6):
        for j in range(i):
            out[6 * i + j] = out[6 * j + i] = 0.5 * (out[6 * i + j] + out[6 * j + i])
    total = 0.0
    for i in range(36):
        total += out[i]
    positive = True
    for i in range(6):
        positive = positive and out[7 * i] > 0.0
    return positive and math.isfinite(total)


@kernel
def _sighted(fits: Vector, count: int, corners: int, limits: Vector, R_bc: Vector, p_bc: Vector, out: Vector) -> int:
    """The sighting that ``count`` of ``fits`` make, into ``out`` (50,): 0 none, 1 one pose, 2 with an alternative.

    ``limits`` (3,) are the expected noise of a corner and the greatest reprojection error (px), and the greatest
    distance (m).
    """
    if count == 0 or not _credible(fits[0], corners, limits):
        return 0
    variance = _corner_variance(fits[0], corners, limits[0])
    if not _covariance(fits[0], variance, R_bc, out[7:43]):
        return 0
    _in_body(fits[0], R_bc, p_bc, out[0:7])
    if count == 1 or not _another(fits[0], fits[1]) or not _credible(fits[1], corners, limits):
        return 1
    if not (fits[1, _SQUARES] - fits[0, _SQUARES]) / variance < LIKELIHOOD_RATIO:
        return 1
    _in_body(fits[1], R_bc, p_bc, out[43:50])
    return 2


class GatePoseSolver:
    """Turns markers into the poses of the gates that carry them.

    Constructing it compiles what it needs, so that nothing is compiled in flight.
    """

    def __init__(self, config: Config, track: Track, camera: CameraModel) -> None:
        limits = config.detection
        self._limits = limits.max_reprojection, limits.max_distance
        self._noise = limits.corner_noise
        self._suspect = SUSPECT * limits.corner_noise
        self._camera = camera
        self._shape = track.gate.marker_corners()
        self._R_bc, self._p_bc = np.array(camera.R_bc, float, order="C"), np.array(camera.p_bc, float)
        self._ids = tuple(gate.id for gate in track.passage)
        self._places = {
            marker_id: (index, slot)
            for index, gate in enumerate(track.passage)
            for slot, marker_id in enumerate(gate.markers)
        }
        self._solve(np.zeros((4, 2)), [0], self._noise)

    def solve(self, stamp: float, markers: Sequence[MarkerDetection]) -> tuple[GateSighting, ...]:
        """Sightings, in the track's order, of the gates that ``markers`` of the exposure at ``stamp`` show.

        Gates are refused that fit worse than ``detection.max_reprojection``, that are further away than
        ``detection.max_distance`` or that show their markers from behind. Markers with corners that are not
        finite, or that no gate carries, are ignored; of two with one id the first counts.
        """
        seen: dict[tuple[int, int], MarkerDetection] = {}
        for marker in markers:
            place = self._places.get(marker.marker_id)
            if place is not None and place not in seen and all(map(math.isfinite, marker.corners.flat)):
                seen[place] = marker
        sightings = []
        for index in sorted({index for index, _ in seen}):
            slots = sorted(slot for gate, slot in seen if gate == index)
            shown = [seen[index, slot] for slot in slots]
            sighting = self._gate(stamp, self._ids[index], shown, slots)
            if sighting is not None:
                sightings.append(sighting)
        return tuple(sightings)

    def _gate(
        self, stamp: float, gate_id: int, markers: Sequence[MarkerDetection], slots: list[int]
    ) -> GateSighting | None:
        noises = [marker.noise if 0.0 < marker.noise < math.inf else self._noise for marker in markers]
        noise = math.sqrt(sum(noise * noise for noise in noises) / len(noises))
        pixels = np.concatenate([marker.corners for marker in markers])
        verdict, out, corners, squares = self._solve(pixels, slots, noise)
        if verdict == 0:
            return None
        return GateSighting(
            stamp=stamp,
            gate_id=gate_id,
            position=out[0:3],
            orientation=out[3:7],
            covariance=out[7:43].reshape(6, 6),
            alternative=(out[43:46], out[46:50]) if verdict == 2 else None,
            markers=corners // 4,
            reprojection=math.sqrt(squares / corners),
        )

    def _solve(self, pixels: Vector, slots: list[int], noise: float) -> tuple[int, Vector, int, float]:
        """`_sighted` of the markers in ``slots`` at ``pixels`` (n, 2), the number of corners used, their error.

        Corners are expected to scatter by ``noise`` (px).
        """
        rays = self._camera.bearings(pixels)
        points = self._shape[slots].reshape(-1, 3)
        fits, count, corners = self._without_outlier(points, rays, corner_weights(self._camera, rays))
        out = np.empty(_SIGHTING)
        limits = np.array((noise, *self._limits))
        verdict = _sighted(fits, count, corners, limits, self._R_bc, self._p_bc, out)
        return verdict, out, corners, float(fits[0, _SQUARES])

    def _without_outlier(self, points: Vector, rays: Vector, weights: Vector) -> tuple[Vector, int, int]:
        """Fits to all markers, or to all but the one that spoils them, how many, and the number of corners.

        Three markers or more are needed to tell which of them is wrong.
        """
        fits, n = np.empty((2, _FIT)), len(points)
        count = _fit(points, rays, weights, fits)
        error = math.sqrt(fits[0, _SQUARES] / n) if count else math.inf
        if n < 12 or error <= self._suspect:
            return fits, count, n
        best, best_count, least = fits, count, IMPROVEMENT * error
        for marker in range(n // 4):
            keep = np.arange(n) // 4 != marker
            trial = np.empty((2, _FIT))
            trial_count = _fit(points[keep], rays[keep], weights[keep], trial)
            error = math.sqrt(trial[0, _SQUARES] / (n - 4)) if trial_count else math.inf
            if error < least:
                best, best_count, least = trial, trial_count, error
        return best, best_count, n if best is fits else n - 4
