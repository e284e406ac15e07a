"""Pages that are made from the code are up to date, and every command that is written down is one that works."""
