"""One gate of which only the marker is known: find it, fly through it, land behind it."""

TRACK = "tracks/one_gate.toml"
SETTINGS = {
    "mission.gates_known": False,
    "mission.geofence": [-8.0, -8.0, -0.5, 12.0, 8.0, 5.0],
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
