"""A short race with a moment's wait before the takeoff: what `flightapp faults` flies."""

import asyncio

TRACK = "tracks/faults.toml"
SETTINGS = {"race.v_max": 3.0, "mission.takeoff_height": 1.4, "race.search_timeout": 5.0, "safety.hold_time": 3.0}


async def mission(drone):
    """Wait until everybody has stepped back, take off, race, land."""
    await asyncio.sleep(4.0)
    await drone.takeoff()
    await drone.race()
    await drone.land()
