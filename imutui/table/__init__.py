"""Turn tables under command: what a controller is, which there are, who commands one, and a virtual one.

`controller` the protocol of all, and their limits · `registry` which there are, by the scheme of a URL · `links` what
bytes go over: TCP, serial line, GPIB · `acutrol` one family's dialect, without I/O · `acutrol_host` such a controller
over a link · `gate` what may be commanded, and whether it is followed · `keeper` the process that has the link ·
`owner` who has the keeper · `acutrol_virtual` a controller that is made up, without I/O, on a table of
`filters.simulation` · `server` the same on a port of this machine.
"""
