"""The state machine and the facade that missions call."""
