"""What must be known of the cameras and trackers, from what they saw."""
