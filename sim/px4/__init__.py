"""A model of PX4: modes, refusals, failsafes, position control, land detection and EKF2 on external vision."""
