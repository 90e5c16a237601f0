"""Record: what is being written, how fast, and what goes into it."""
