"""One gate that is hardly known beforehand: find it, fly through it, land behind it."""

TRACK = "tracks/one_gate.toml"
SETTINGS = {"race.v_max": 2.0, "race.standoff": 2.0}


async def mission(drone):
    """Take off, race, land."""
    await drone.takeoff()
    await drone.race()
    await drone.land()
