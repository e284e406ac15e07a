"""The paper's experiments, as they are flown here, and what is not the same."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from flightapp.inputs import BadInputError

EXACT = ("sim.tracker=ideal", "estimation.estimator=t265")
"""The simulator's own state, taken as it is."""
PROFILING = 14
"""The table of computation times, for which nothing is flown."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One of the paper's experiments."""

    name: str
    """As the keys of its tables in data/paper.json begin: "lemniscate_sim"."""
    title: str
    mission: Path
    vehicle: Path
    v_max: tuple[float, ...]
    """m/s, as the paper flew it."""
    tables: tuple[int, ...]
    figures: tuple[int, ...]
    length: float
    """m, about; what takes longest is flown first."""
    differs: str
    """What is not the same as in the paper."""
    exact: bool = False
    """Whether the paper took the state from its simulator."""
    settings: tuple[str, ...] = ()
    beyond: tuple[float, ...] = ()
    """m/s, flown besides, without numbers of the paper."""
    closer: Mapping[float, tuple[str, ...]] = field(default_factory=dict)
    """Settings by v_max of flights that are closer to the paper's, to see what makes the difference."""
    closer_name: str = ""
    """What is closer about them."""


EXPERIMENTS = (
    Experiment(
        "lemniscate_sim",
        "lemniscate in simulation",
        Path("missions/lemniscate.py"),
        Path("config/sim_iris.toml"),
        (3.0, 5.0, 7.0),
        (1, 2, 3),
        (3,),
        34.0,
        "The paper flew PX4's iris in Gazebo and took its state from the simulator; here it is estimated from a"
        " simulated T265 and an accelerometer with their errors. One lap per flight, rest to rest. The paper does not"
        " give the curve's size: 11 m × 5.5 m fit its mean speeds and times.",
        exact=True,
        closer=dict.fromkeys((3.0, 5.0, 7.0), EXACT),
        closer_name="with the simulator's state",
    ),
    Experiment(
        "lemniscate_real",
        "lemniscate in the real world",
        Path("missions/lemniscate.py"),
        Path("config/sim_f330.toml"),
        (3.0, 5.0, 7.0),
        (4, 5, 6),
        (4,),
        34.0,
        "The paper flew a real F330; here it is simulated, its parameters from published measurements and estimates."
        " As there, the state is the T265's own (estimation.estimator = t265).",
        settings=("estimation.estimator=t265",),
        closer={3.0: ("race.v_max=1.3",)},
        closer_name="at the paper's pace",
    ),
    Experiment(
        "five_gates_sim",
        "five gates in simulation",
        Path("missions/five_gates.py"),
        Path("config/sim_iris.toml"),
        (1.0, 2.0, 3.0, 4.0),
        (7, 8),
        (5, 6),
        50.0,
        "The paper took its state from Gazebo; here it is estimated from a simulated T265 and from the gates. It does"
        " not give the gates' places: these fit its area and its mean speeds and times. Each gate carries four markers,"
        " one in each corner of its frame. Each seed draws the gates' errors anew, within the paper's 3 m.",
        exact=True,
    ),
    Experiment(
        "one_gate_real",
        "one unknown gate in the real world",
        Path("missions/one_gate_unknown.py"),
        Path("config/sim_f330.toml"),
        (1.0, 2.0, 3.0, 4.0),
        (9, 10, 11),
        (7,),
        5.5,
        "The paper flew a real F330 and measured the T265's error; here both are simulated, and the estimate is fused"
        " from the T265, the accelerometer and the gate. Only the gate's marker is known beforehand.",
    ),
    Experiment(
        "four_gates_real",
        "four gates in the real world",
        Path("missions/four_gates.py"),
        Path("config/sim_f330.toml"),
        (0.5, 1.0),
        (12, 13),
        (8, 9),
        13.0,
        "The paper flew a real F330; here it is simulated. It gives the rectangle, 5 m × 4 m, but neither the gates'"
        " heights nor where a lap starts and ends.",
        beyond=(2.0, 3.0, 4.0),
    ),
    Experiment(
        "four_gates_racer",
        "four gates with a racing quadrotor",
        Path("missions/four_gates.py"),
        Path("config/sim_racer.toml"),
        (),
        (12, 13),
        (),
        13.0,
        "Rows beyond what the F330's acceleration gives on so small a track are a racing quadrotor's, of thrust/weight"
        " 3.1, with race.a_max = 20 m/s².",
        settings=("race.a_max=20",),
        beyond=(6.0, 8.0),
    ),
)


def read_only(text: str | None) -> tuple[int, ...]:
    """The tables in "table7,table8" or "7,8"; all of them if there is no ``text``; raises `BadInputError`."""
    known = (*sorted({number for experiment in EXPERIMENTS for number in experiment.tables}), PROFILING)
    if text is None:
        return known
    chosen = []
    for word in text.split(","):
        digits = word.strip().lower().removeprefix("table").strip()
        if not digits.isdecimal() or int(digits) not in known:
            raise BadInputError(f"--only {text}: '{word.strip()}' is no table of the paper; table1 to table{known[-1]}")
        chosen.append(int(digits))
    return tuple(number for number in known if number in chosen)


def needed(tables: Sequence[int]) -> list[Experiment]:
    """The experiments that have to be flown for ``tables``."""
    return [experiment for experiment in EXPERIMENTS if set(experiment.tables) & set(tables)]
