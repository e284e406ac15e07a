"""What can go wrong, how it is noticed, and what is done then."""
