"""What is remembered of each gate, and maps that outlive a flight."""
