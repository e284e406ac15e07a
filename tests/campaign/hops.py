"""A mission so short that many can be flown."""

from pathlib import Path

from flightapp import app
from flightapp.campaign.run import Run

HOP = '''"""Up and down again."""

TRACK = "{track}"
SETTINGS = {{"mission.takeoff_height": 0.5}}


async def mission(drone):
    await drone.takeoff()
    await drone.land()
'''
PAD = Path(__file__).parents[2] / "missions" / "tracks" / "pad.toml"


def hops(directory, count, *overrides, first=0, name="hop.py"):
    """``count`` runs of a mission written to ``directory``."""
    mission = directory / name
    mission.write_text(HOP.format(track=PAD))
    settings = ("sim.camera='corners'", *overrides)
    plans = [app.FlightPlan(mission, Path(), overrides=settings, seed=seed) for seed in range(first, first + count)]
    return [Run(plan, "hop") for plan in plans]
