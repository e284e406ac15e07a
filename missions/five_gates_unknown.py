"""Five gates of which only the number and the markers are known: the drone finds them as it goes."""

TRACK = "tracks/five_gates.toml"
SETTINGS = {
    "mission.gates_known": False,
    "geofence.corners": [(-20.0, -16.0), (16.0, 16.0)],
    "geofence.floor": -0.5,
    "geofence.ceiling": 8.0,
    "mission.takeoff_height": 1.5,
    "race.v_max": 3.0,
    "race.search_timeout": 180.0,
    "race.timeout": 600.0,
}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
