"""Four gates around a rectangle of 5 m × 4 m, of which only the number and the markers are known."""

TRACK = "tracks/four_gates_far.toml"
SETTINGS = {
    "mission.gates_known": False,
    "geofence.corners": [(-6.0, -6.0), (6.0, 6.0)],
    "geofence.floor": -0.5,
    "geofence.ceiling": 4.0,
    "mission.takeoff_height": 1.5,
    "race.v_max": 1.0,
    "race.a_max": 4.0,
    "race.standoff": 2.0,
    "race.search_step": 3.0,
    "race.search_timeout": 180.0,
    "race.timeout": 600.0,
}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
