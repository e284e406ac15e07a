"""How good a vehicle file is, and how it could be better."""
