"""Crossbow's IMU440, MEMSIC's IMU380 and Aceinna's IMU381: bytes to events and back, the dialogue, and a virtual unit.

`frames` preamble, length and CRC · `frame_search` frames in a stream of bytes · `messages` what goes over the line ·
`payloads` their bytes · `decoder` both ends of the line · `fields` configuration fields · `scaling` counts to units ·
`counter` packets lost, by the counter's step · `unit` an IMU381 as a state machine, with `unit_options`,
`configuration`, `schedule`, `packet_makers` and `request_text`. No I/O, no clock, and no exception for noise.
`host` the host side, with `requests` and `readings`, which has both · `instrument` its data.
"""
