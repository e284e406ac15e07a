"""From poses to the state of the vehicle."""
