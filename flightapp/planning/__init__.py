"""From a gate map to a trajectory."""
