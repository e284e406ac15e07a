"""Flights on request: the service that waits for missions, and what talks to it over a Unix socket."""
