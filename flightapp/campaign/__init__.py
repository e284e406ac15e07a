"""Many flights: what each of them is, where they are flown, and what is kept of them."""
