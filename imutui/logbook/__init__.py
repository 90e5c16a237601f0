"""Log files: MCAP with ROS 2 messages, written so that a pulled plug costs a second, read by us and by others' tools.

`schemas` what the messages hold · `session_info` the metadata · `writer`, `reader` the file · `mcap_format` its
records, `scan` what lies in a damaged one, `message_arrays` every message of it, `recover` a whole one made of what is
left · `importer` recordings made elsewhere, `import_reference` what they know of their motion, `arrival_stamps` their
sampling instants · `reference_file`, `trajectory_file`, `effects_file` the other formats · `results` the JSON document
of a replay or a live run. The only user of mcap.
"""

from imutui.logbook.session_info import SessionInfo

__all__ = ["SessionInfo"]
