"""Table: choose a profile, and be guided through it."""
