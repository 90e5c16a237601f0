"""The acquisition process: it owns the port and the file, and lives on without any terminal.

Its beginning: `plan` · `metadata` of its logs, their names, and the log before them. With the instrument:
`reader_thread` reads the port or asks for packets · `reconnection` finds the same unit.
Its threads: `engine` starts and ends them and queues requests · `lifecycle` its state and the record of its end ·
`stream` the events that the reader hands on, and their consumers' protocol · `acquisition` the list of consumers.
Its consumers: `recording` the files one after the other, `run` a run of samples
and its file, with `live_filter` · `channel_statistics` · `watches` of line, unit and clock · `guidance`.
For viewers: `snapshot` the records they get · `observe` fills the snapshot · `requests` carries out their requests ·
`ipc` the socket · `client` starts an acquisition and talks to it, `processes` begins, forks and ends processes, `batch`
does so with several.
`python -m imutui.session` is the process itself.
"""
