"""The instrument's side of the program: protocol, port, time, and virtual units.

`driver` what every instrument has, with `counts` · `registry` the instruments there are, `names` their names ·
`imu400/` the IMU400CD · `uut/` the protocol of the IMU440, IMU380 and IMU381 · `frame_search` messages of any protocol
in a stream of bytes, no I/O · `counter_spec` what counters count · `clock` counter to time, no I/O, with `host_time`
and `packet_count` · `port` the only user of pyserial · `virtual_instrument` what virtual units have in common, with
`transmitter`, their UART · `virtual` a unit and its line on a `pseudo_terminal`.
"""
