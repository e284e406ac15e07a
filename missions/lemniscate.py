"""A figure of eight, 11 m by 5.5 m, as the paper's control experiment."""

TRACK = "tracks/lemniscate.toml"
SETTINGS = {"race.v_max": 3.0, "planning.waypoint_radius": 0.3}


async def mission(drone):
    """Take off, fly the laps that mission.laps asks for, land."""
    await drone.takeoff()
    for _ in range(drone.laps):
        await drone.follow()
    await drone.land()
