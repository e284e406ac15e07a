"""Flight logs: written in flight, read afterwards."""
