"""The in-process world: vehicle, autopilot model, sensors, virtual time and the referee."""
