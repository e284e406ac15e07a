"""From a trajectory and a state to body rates and thrust."""
