"""The instrument's side of the program: protocol, port, time, and a virtual unit.

`crossbow` bytes and events, no I/O · `clock` counter to time, no I/O · `port` the only user of pyserial · `virtual` an
IMU400CD-200 on a pseudo-terminal.
"""
