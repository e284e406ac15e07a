"""From gate sightings to a gate map."""
