"""A closed circuit of five gates; fly more laps with --set mission.laps=3."""

TRACK = "tracks/five_gates_loop.toml"
SETTINGS = {"race.v_max": 4.0, "mission.takeoff_height": 1.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
