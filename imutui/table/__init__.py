"""Turn tables under command: motions, controllers, the process that commands one, and a virtual one.

`motion` what an axis does, and its limits · `follower` whether it does so · `controller` the protocol of all ·
`registry` which there are, by the scheme of a URL · `links` what bytes go over: TCP, serial line, GPIB · `acutrol` one
family's dialect, without I/O · `acutrol_host` such a controller over a link · `keeper` the process that has the link ·
`owner` the process that commands · `messages` between them · `acutrol_virtual` a virtual controller, without I/O, on a
table of `filters.simulation` · `server` the same on a port of this machine.
"""
