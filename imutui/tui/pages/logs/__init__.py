"""Logs: recordings, what is in them, and what can be made of them."""
