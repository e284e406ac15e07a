"""Four gates with two pillars and a wall between them, which the race planner goes around."""

TRACK = "tracks/pillars.toml"
SETTINGS = {"race.v_max": 4.0, "mission.takeoff_height": 1.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
