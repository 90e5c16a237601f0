"""The instrument's side of the program: protocol, port, time, and virtual units.

`instrument` what an instrument is, with `host`, `identity` and `discarded` · `registry` which there are, `names`
what they are called ·
`imu400/` the IMU400CD · `uut/` the protocol of the IMU440, IMU380 and IMU381 · `counter_spec` what counters count ·
`clock` counter to time, no I/O, with `host_time` and `packet_count` · `port` the only user of pyserial ·
`virtual_instrument` what a virtual unit is to its line, with `reading` · `transmitter` its UART · `faults` of its
line · `wire` unit and line as one, no I/O · `virtual` the same on a `pseudo_terminal`, with `sent_packets`.
"""
