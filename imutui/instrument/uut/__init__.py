"""Crossbow's IMU440, MEMSIC's IMU380 and Aceinna's IMU381: bytes to events and back, the dialogue, and a virtual unit.

`frames` preamble, length and CRC · `messages` what goes over the line · `decoder` both ends of it · `fields`
configuration fields · `counter` whether a unit began anew, by the counter's step · `driver` the family's data and the
dialogue · `unit` an IMU381 as a state machine, with `unit_options` and `packet_makers`. No I/O but in `driver`.
"""
