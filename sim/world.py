"""The simulated world: one vehicle among gates, judged on its true motion."""

from collections.abc import Callable, Sequence

import numpy as np

from flightapp.channel import Topic
from flightapp.config import Config
from flightapp.frames import Vector
from flightapp.interfaces import GroundTruthFeed
from flightapp.messages import Collision, GatePassage, GroundTruth
from flightapp.track import Track
from sim.autopilot import SimAutopilot
from sim.faults import Fault
from sim.imu import Imu
from sim.mismatch import mismatched
from sim.plant import Plant
from sim.referee import GROUND, Referee
from sim.survey import true_gates
from sim.vehicle_faults import VehicleFaults


class World:
    """Physics, autopilot and referee, advanced together to whatever time it has become."""

    def __init__(
        self,
        config: Config,
        track: Track,
        seed: np.random.SeedSequence,
        time: Callable[[], float],
        faults: Sequence[Fault] = (),
    ) -> None:
        plant_seed, autopilot_seed, imu_seed, mismatch_seed = (int(s.generate_state(1)[0]) for s in seed.spawn(4))
        vehicle = mismatched(config.sim, mismatch_seed)
        self.plant = Plant(
            vehicle,
            plant_seed,
            step=config.sim.step,
            wind=config.sim.wind,
            gust=config.sim.gust,
            position=track.start.position,
            yaw=track.start.yaw,
            start=time(),
        )
        self.autopilot = SimAutopilot(config, self.plant, autopilot_seed, time)
        self.px4 = self.autopilot.px4
        self._faults = VehicleFaults(faults, self.autopilot, config, lambda: self.track)
        self._imu = Imu(imu_seed)
        self.referee = Referee(track, vehicle.radius, config.mission.laps)
        self.truth = GroundTruthFeed(
            Topic("truth"), Topic("passage"), Topic("collision"), Topic("true_gates"), Topic("arrivals")
        )
        self._time = time
        self._later: list[tuple[float, Track]] = []
        self.track = track
        """How everything stands now."""
        true_gates(track)

    def announce(self) -> None:
        """Publish where the gates really are, for the log."""
        self.truth.gates.publish(true_gates(self.track))

    def rearrange(self, stamp: float, track: Track) -> None:
        """At ``stamp`` let the gates stand as ``track`` says, which has the same ones."""
        self._later.append((stamp, track))

    def advance(self) -> None:
        """Bring everything to the present, then judge it; who hits something loses its motors here."""
        now = self._time()
        if now - self.plant.time < 1e-9:
            return
        self._faults.run(now)
        self.autopilot.advance(now)
        for verdict in self.referee.observe(self.plant.trace):
            self._announce(verdict)
        while self._later and self._later[0][0] <= now:
            self.track = self._later.pop(0)[1]
            self.referee.rearrange(self.track)
            self.announce()

    def state_at(self, stamp: float) -> GroundTruth:
        """The true motion at a recent ``stamp``."""
        row = self.plant.state_at(stamp)
        return GroundTruth(stamp, row[1:4], row[4:8], row[8:11], row[11:14])

    def pose_at(self, stamp: float) -> tuple[Vector, Vector]:
        """True position (3,) and orientation (4,) at a recent ``stamp``."""
        row = self.plant.state_at(stamp)
        return row[1:4], row[4:8]

    def feel(self, stamp: float) -> None:
        """Have the autopilot pass on what its inertial sensors measure at a recent ``stamp``."""
        row = self.plant.state_at(stamp)
        self.autopilot.feel(self._imu.sample(stamp, row[14:17], row[11:14]))

    def _announce(self, verdict: GatePassage | Collision) -> None:
        if isinstance(verdict, GatePassage):
            self.truth.passages.publish(verdict)
        else:
            self.truth.collisions.publish(verdict)
            if not (self._faults.tipped and verdict.obstacle == GROUND):
                self.autopilot.crash()
