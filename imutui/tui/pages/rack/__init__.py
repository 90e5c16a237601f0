"""Rack: the units of a batch, a line each."""
