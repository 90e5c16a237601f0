"""Turn tables under command: motions, a controller, the processes that command it, and a virtual one.

`motion`: motions of an axis, and its limits · `follower`: whether the axes follow them · `links`: TCP, serial line and
GPIB · `acutrol`: a controller over a link, and its URLs · `keeper`: the process that has the link · `owner`: the
process that commands · `messages`: between them · `acutrol_virtual`: a virtual controller, without I/O, on a table of
`filters.simulation` · `server`: the same on a port of this machine.
"""
