"""Log files: MCAP with ROS 2 messages, written so that a pulled plug costs a second, read by us and by others' tools.

`atomic_file` the one writer of files, `file_lock` whether a process writes one ·
`schemas` what the messages hold · `session_info` the metadata · `writer`, `reader` the file · `mcap_format` its bytes
and its index · `walk` its items in order, damage among them, `mcap_stream` messages in batches,
`scan` what a walk beyond damage reports of a file, `summary` its ends ·
`columns` messages as arrays, `samples` samples with their temperatures, `audit` all messages and the figures of a
whole log · `pieces` a log of any length in bounded memory, `sample_check` whether its samples can be used and what they lack, `export` it as CSV, NPZ or Parquet,
`parquet` the library of the last · `recover` a whole file made of what is left · `importing` recordings made elsewhere,
`import_reference` what they know of their motion, `arrival_stamps` their sampling instants · `polled_rate` whether
polling kept what was asked · `power_on` logs that continue others · `reference_file` table profiles, those too that
need no file, `trajectory_file`, `effects_file` other formats · `results` the JSON document of a replay or a live run.
The only user of mcap, zstandard, lz4 and rosbags.
"""

from imutui.logbook.session_info import SessionInfo

__all__ = ["SessionInfo"]
