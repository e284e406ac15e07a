"""What is looked at before a flight besides the autopilot: this computer, the camera, the source of poses."""
