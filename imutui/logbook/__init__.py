"""Log files: MCAP with ROS 2 messages, written so that a pulled plug costs a second, read by us and by others' tools.

Messages: `layout` makes a message's layout from its ROS definition, `schemas` encodes and decodes each message,
`columns` reads many as arrays.
Files: `mcap_format` parses records and the index, `walk` yields a file's items with damage among them, `mcap_stream`
joins messages to batches, `scan` reports the damage, `summary` reads the ends, `writer` writes, `recover` rebuilds.
`session_info` is a log's metadata, `log_time` its clock.
Contents: `samples` holds samples with their temperatures, `reader` reads a log, `pieces` one of any length, `audit`
counts its messages, `sample_check` judges its samples, `reading` holds what a caller states of it, `power_on` joins
logs of one power-on, `polled_rate` judges a polled rate.
Recordings of others: `foreign_log` plans how an MCAP file is read, `bag` converts bags, `importing` reads tables,
`import_reference` their motion, `arrival_stamps` fits their sampling instants.
Other files: `export` and `parquet` write samples, `reference_file`, `trajectory_file` and `effects_file` are inputs,
`results` fills the record of what a filter has come to and the document of a run, `estimate_rows` the estimates of a
log, `atomic_file` writes any file, `file_lock` guards one that is being written.
The only user of mcap, zstandard, lz4 and rosbags.
"""

from imutui.logbook.session_info import SessionInfo

__all__ = ["SessionInfo"]
