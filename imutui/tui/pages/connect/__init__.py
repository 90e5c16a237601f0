"""Connect: choose a port and how to read it, or take up a running acquisition."""
