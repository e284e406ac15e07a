"""The simulated vehicle behind MAVLink on UDP, as PX4 v1.16 would speak it."""
