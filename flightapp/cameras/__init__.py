"""Real cameras, and recordings of them."""
