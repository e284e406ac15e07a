"""The gates, of which only the markers are known, are looked for one by one; then they are raced through."""

TRACK = "tracks/five_gates.toml"
SETTINGS = {
    "mission.gates_known": False,
    "geofence.corners": [[-20.0, -16.0], [16.0, 16.0]],
    "geofence.floor": -0.5,
    "geofence.ceiling": 8.0,
    "mission.takeoff_height": 1.5,
    "race.v_max": 3.0,
    "race.timeout": 600.0,
}


async def mission(drone):
    """Take off, look for each gate, race through what was found, land."""
    await drone.takeoff()
    for gate in drone.track.passage:
        await drone.search(gate.id, seconds=120.0, check=False)
    await drone.goto(*drone.track.start.position[:2], 1.5)
    await drone.race()
    await drone.land()
