"""Crossbow's IMU400CD: bytes to events and back, the dialogue with it, and a virtual unit.

`crossbow` bytes to events and back, no I/O, with `messages`, `scaling`, `inbox`, `packet_search` and `reply_search` ·
`host` the host side, with `handshake`, `replies`, `polling`, `zeroing` and `measurement_mode` · `instrument` its data ·
`unit` a virtual one as a state machine, no I/O, with `unit_options`, `sampling_loop` and `command_text`.
"""
