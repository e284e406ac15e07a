"""From poses, inertial sensors and sightings of gates to vehicle and gates."""
