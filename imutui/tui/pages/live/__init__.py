"""Live: what the instrument says now, and said in the last seconds."""
