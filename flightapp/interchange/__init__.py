"""Recordings of other programs, read and written."""
