"""Four gates in the middle of the sides of a 5 m × 4 m rectangle, one marker each."""

TRACK = "tracks/four_gates.toml"
SETTINGS = {"race.v_max": 1.0, "race.standoff": 2.0, "mission.takeoff_height": 1.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
