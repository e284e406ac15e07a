"""From a request to what will be flown: a plan that touches nothing, at a pace at which the vehicle stays on it."""

from collections.abc import Sequence

from flightapp.config import Config
from flightapp.interfaces import Planner, PlanningError, PlanRequest
from flightapp.messages import GateEstimate
from flightapp.planning.clearance import touched
from flightapp.planning.feasibility import Screen
from flightapp.planning.geofence import Geofence
from flightapp.planning.goal import Goal
from flightapp.planning.obstacles import Margins
from flightapp.planning.pacer import Paced, Pacer
from flightapp.planning.splice import splice_fault
from flightapp.trajectory import Trajectory


class Answerer:
    """Plans, looks whether the plan can be flown, and flies it slower where that mends it."""

    def __init__(self, config: Config, planner: Planner, pacer: Pacer) -> None:
        self._planner = planner
        self._pacer = pacer
        self._margins = Margins.of(config)
        self._fence = Geofence.of(config.geofence)
        self._screen = Screen(config) if config.planning.screen else None

    def answer(
        self, goal: Goal, request: PlanRequest, gates: Sequence[GateEstimate], rate: float, has_time: bool
    ) -> Paced:
        """What to fly for ``request``, at the pace ``rate`` if that can be flown; raises `PlanningError`.

        ``gates`` are those whose frames are known. Without time no forward simulation is flown.
        """
        plan = self._plan(goal, request)
        if fault := splice_fault(plan, request.start):
            raise PlanningError(fault)
        if out := self._fence.exit(plan):
            raise PlanningError(str(out))
        if touch := touched(plan, gates, request.shape, request.obstacles, self._margins):
            raise PlanningError(str(touch))
        why = ""
        for choice in self._pacer.offers(plan, request, rate):
            if self._screen is None or not has_time:
                return choice
            flown = self._screen.check(choice.flown)
            if flown.ok:
                return choice
            why = why or flown.why
        raise PlanningError(why)

    def _plan(self, goal: Goal, request: PlanRequest) -> Trajectory:
        try:
            if goal.waypoints is None:
                return self._planner.plan(request)
            return self._planner.through(goal.waypoints, request)
        except PlanningError:
            raise
        except Exception as error:  # a planner may be anybody's, and in flight its failure must not end the planning
            raise PlanningError(f"the planner failed: {type(error).__name__}: {error}") from error
