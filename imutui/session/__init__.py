"""The acquisition process: it owns the port and the file, and lives on without any terminal.

`plan` what is asked of it · `metadata` of its logs, and their names · `handshake` the opening dialogue with the
instrument · `reader_thread` reads the port · `averaging` packets to output samples · `recording` one run of recorder
and filter, `rotation` its files · `live_filter` the filter · `recent_packets` statistics for the screen · `engine` the
threads and requests · `operator_guide` through a table profile · `zeroing` the rate sensors · `snapshot` what viewers
see, `observe` fills it · `ipc` the socket · `client` how viewers start it and talk to it · `port_probe` what answers at
a port. `python -m imutui.session` is the process itself.
"""
