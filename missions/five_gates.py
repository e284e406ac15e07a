"""Five gates, each known only to within 3 m before the flight."""

TRACK = "tracks/five_gates.toml"
SETTINGS = {"race.v_max": 4.0, "mission.takeoff_height": 1.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
