"""What all tests share."""

from hypothesis import settings

# Compilation makes the first example slow, and a run must be repeatable.
settings.register_profile("flightapp", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("flightapp")
