"""The acquisition process: it owns the port and the file, and lives on without any terminal.

What is asked: `plan` · `metadata` of its logs, their names, and changes of what the filter takes.
With the instrument, by its host side: `offers` what can be asked of it · `identity` what the unit says of itself ·
`reader_thread` reads the port or asks for packets · `zeroing` the rate sensors · `port_probe` what answers at a port ·
`reconnection` finds the same unit again, `absence` says how long it was away · `gravity_check` how it lies.
Its threads: `engine` starts and ends them and takes requests · `acquisition` what happens with packets and requests ·
`lifecycle` where it stands · `duration` when it is over · `line_watch` what is to be said of the line, with `silence`.
From packets to a file: `packet_stamps` when each was sampled · `sample_pipeline` a run of samples ·
`averaging` packets to samples · `live_filter` the filter · `run_history` its past ·
`recording` the file's life, `rotation` when it is full, `previous_log` what was before it ·
`vanished_file` whether it is there still · `disk_space` · `timebase` UTC that no clock step moves.
For viewers: `snapshot` what they see and `requests` what they ask, records only, `request_fields` read from one that
may be anything · `observe` fills the snapshot, with
`observe_filter`, `observe_estimator`, `recent_packets`, `event_log` · `operator_guide` through a table profile · `ipc`
the socket · `client` how they start an acquisition and talk to it, `overview` to all of them · `exit_codes`.
For Foxglove: `live_stream` hands on what is recorded to a process of its own, `foxglove_server`.
`python -m imutui.session` is the process itself.
"""
