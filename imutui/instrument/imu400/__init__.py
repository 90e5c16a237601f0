"""Crossbow's IMU400CD: bytes to events and back, the dialogue with it, and a virtual unit.

`crossbow` messages and their bytes, with `scaling` · `decoder` the host's side of the line, no I/O · `driver` the
unit's data and the dialogue · `unit` a virtual one as a state machine, no I/O.
"""
