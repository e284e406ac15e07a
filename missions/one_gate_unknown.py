"""One gate of which only the marker is known: find it, fly through it, land behind it."""

TRACK = "tracks/one_gate.toml"
SETTINGS = {
    "mission.gates_known": False,
    "geofence.corners": [(-8.0, -8.0), (12.0, 8.0)],
    "geofence.floor": -0.5,
    "geofence.ceiling": 5.0,
    "mission.takeoff_height": 1.5,
    "race.v_max": 2.0,
    "race.standoff": 2.0,
    "race.search_timeout": 180.0,
    "race.timeout": 600.0,
}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
