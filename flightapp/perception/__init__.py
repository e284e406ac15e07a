"""From an image to gate sightings."""
