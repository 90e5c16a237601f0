"""The acquisition process: it owns the port and the file, and lives on without any terminal.

What is asked, and what can be: `plan` · `metadata` of its logs, their names, and changes of what the filter takes.
With the instrument, by its host side: `identity` what the unit says of itself · `reader_thread` reads the port or asks
for packets · `port_probe` what answers at a port · `reconnection` finds the same unit.
Its threads: `engine` starts and ends them and takes requests · `lifecycle` where it stands · `stream` the events that
the reader hands on, and their consumers' protocol · `acquisition` the list of consumers, and requests.
Its consumers: `recording` the files one after the other, `previous_log` what was before them · `run` a run of samples
and its file, with `live_filter` · `channel_statistics` · `watches` of line, unit and clock · `guidance`.
For viewers: `snapshot` what they see, records only · `requests` what they ask · `observe` fills the snapshot ·
`ipc` the socket · `client` how they start an acquisition and talk to it, `preloaded` several that share memory ·
`end_report` how one ended.
`python -m imutui.session` is the process itself.
"""
