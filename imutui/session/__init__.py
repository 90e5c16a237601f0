"""The acquisition process: it owns the port and the file, and lives on without any terminal.

What is asked, and what can be: `plan` · `metadata` of its logs, their names, and changes of what the filter takes.
With the instrument, by its host side: `identity` what the unit says of itself · `reader_thread` reads the port or asks
for packets · `port_probe` what answers at a port · `reconnection` finds the same unit.
Its threads: `engine` starts and ends them and takes requests · `acquisition` what happens with packets and requests ·
`lifecycle` where it stands · `watches` what is looked at each second, the line among it.
From packets to a file: `sample_pipeline` a run of samples, means of packets · `live_filter` the filter and its past ·
`recorder` runs and files one after the other, and when it is over · `recording` a recording's files, `previous_log`
what was before it · `disk_space` room, and whether a file is there still · `timebase` UTC that no clock step moves.
For viewers: `snapshot` what they see, records only · `requests` what they ask · `observe` fills the snapshot, with
`recent_packets`, `event_log` · `channel_statistics` · `guidance` through a table profile · `ipc`
the socket · `client` how they start an acquisition and talk to it, `preloaded` several that share memory · `end_report`
how one ended.
`python -m imutui.session` is the process itself.
"""
