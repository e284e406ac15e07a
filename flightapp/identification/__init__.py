"""What a vehicle's configuration must say, found in its flight logs. Pure fits: arrays in, numbers out."""
