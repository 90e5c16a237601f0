"""The instrument's side of the program: protocol, port, time, and a virtual unit.

`crossbow` bytes to events and back, no I/O, with `messages`, `scaling`, `inbox`, `packet_search` and `reply_search` ·
`clock` counter to time, no I/O, with `host_time` and `packet_count` · `port` the only user of pyserial ·
`virtual_instrument` what a virtual unit is to its line · `unit` an IMU400CD as a state machine, no I/O, with
`unit_options`, `sampling_loop`, `transmitter` and `command_text` ·
`faults` of its line · `wire` unit and line as one, no I/O ·
`virtual` the same on a `pseudo_terminal`, with `sent_packets` · `uut/` the protocol of the IMU440, IMU380 and IMU381.
"""
