"""What the drone can do, each watching its own execution."""
