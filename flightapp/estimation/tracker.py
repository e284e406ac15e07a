"""The tracker's poses as they are: the paper's estimator, to compare with."""

from dataclasses import replace

from flightapp.config import Config
from flightapp.estimation.fusion import FusionEstimator
from flightapp.messages import GateEstimate, GateMap, ImuSample, PoseSample, Sightings, VehicleState
from flightapp.track import Track

FAULTLESS = {
    "start_position": 1e-3,
    "start_yaw": 1e-3,
    "scale_error": 1e-6,
    "drift_walk": 0.0,
    "drift_at_rest": 1e-6,
    "yaw_walk": 0.0,
    "yaw_at_rest": 1e-6,
    "slip_across": 0.0,
    "slip_up": 0.0,
}
"""What is believed of the tracker."""
GATE_WALK = 0.05
"""m/√s, by which gates seem to wander as the tracker drifts."""


class TrackerEstimator:
    """The tracker's poses are taken for the vehicle's; only the gates are estimated, in the tracker's frame.

    The covariance is that of the tracker's noise, since its drift is not known to this estimator.
    """

    def __init__(self, config: Config, track: Track) -> None:
        believed = {
            "estimation": config.estimation.model_copy(update=FAULTLESS),
            "mapping": config.mapping.model_copy(update={"gate_walk": GATE_WALK}),
        }
        self._filter = FusionEstimator(config.model_copy(update=believed), track)

    def on_imu(self, sample: ImuSample) -> VehicleState | None:
        """Nothing: inertial sensors are not used."""

    def on_pose(self, sample: PoseSample) -> VehicleState | None:
        """``sample`` as the vehicle's state; None where it is not newer than the last."""
        state = self._filter.on_pose(sample)
        if state is None:
            return None
        return replace(state, position=sample.position, orientation=sample.orientation, velocity=sample.velocity)

    def on_sightings(self, seen: Sightings) -> bool:
        """Use what was seen from where the tracker was; whether the map changed."""
        return self._filter.on_sightings(seen)

    def gate_map(self, stamp: float) -> GateMap:
        """The gates in the tracker's frame."""
        return self._filter.gate_map(stamp)

    def places(self) -> tuple[GateEstimate, ...]:
        """The same gates with their covariances in that frame, to be kept for another flight."""
        return self._filter.places()

    def take_notices(self) -> tuple[str, ...]:
        """What there is to tell since the last call, in words."""
        return self._filter.take_notices()
