"""The five gates with the paper's one marker each, above the opening."""

TRACK = "tracks/five_gates_single.toml"
SETTINGS = {"race.v_max": 3.0, "mission.takeoff_height": 1.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
