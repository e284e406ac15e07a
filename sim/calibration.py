"""What a careful calibration leaves wrong with a camera: the application is told one camera, and another one films.

Drawn once for each flight. The sizes are those of one standard deviation:

* Lens: the standard errors that MATLAB's `displayErrors` shows for its two example calibrations are 1038.0 ± 0.65 px of
  focal length, ± 0.34 px of principal point and ± 0.0008 of the first coefficient for a pinhole camera, 875.1 ± 0.95 px
  and ± 0.69 px for a fisheye. These are those of the corners' noise alone. A lens model that does not quite fit,
  warmth, and landings that shift the lens come on top: 3.5 times the greater error of the focal length, and twice that
  of the coefficient (assumption).
* Mount: P. Furgale, J. Rehder and R. Siegwart, "Unified temporal and spatial calibration for multi-sensor systems"
  (2013, the method of Kalibr) estimate rotation, position and time offset of a camera together, and more precisely than
  a racing frame keeps them from one landing to the next. 0.2° and 2 mm are what it may give way by (assumption).
* Synchronisation: a millisecond, about a sixth of the pose source's period and latency together (assumption; a
  calibrated offset that is applied to stamps of another clock).
"""

from dataclasses import replace

import numpy as np

from flightapp.frames import quat_from_rotvec, quat_to_matrix
from flightapp.perception.camera import CameraModel

FOCAL = 0.0035
"""Share of the focal length, the same along both axes."""
CENTRE = 0.6
"""px, of the principal point, along each axis."""
DISTORTION = 0.002
"""Of the first coefficient."""
TURN = 0.0035
"""rad, of the mount, about each axis."""
PLACE = 0.002
"""m, of the camera in the body frame, along each axis."""
SYNC = 0.001
"""s, between the stamps and the middle of the exposure."""


def true_camera(told: CameraModel, times: float, seed: int) -> tuple[CameraModel, float]:
    """The camera that is taken for ``told``, with ``times`` the errors above; s by which it films after its stamps."""
    draw = np.random.default_rng((seed, 1)).standard_normal(11) * times
    scale = 1.0 + FOCAL * draw[0]
    focal = told.focal * (scale, scale, 1.0, 1.0)
    focal[2:] += CENTRE * draw[1:3]
    distortion = told.distortion + DISTORTION * draw[3] * np.array((1.0, 0.0, 0.0, 0.0))
    turned = quat_to_matrix(quat_from_rotvec(TURN * draw[4:7]))
    place = told.p_bc + PLACE * draw[7:10]
    true = replace(told, focal=focal, distortion=distortion, R_bc=turned @ told.R_bc, p_bc=place)
    return true, float(SYNC * draw[10])
