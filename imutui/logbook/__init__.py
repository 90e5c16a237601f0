"""Log files: MCAP with ROS 2 messages, written so that a pulled plug costs a second, read by us and by others' tools.

`schemas` what the messages hold · `session` the metadata · `writer`, `reader` the file · `importer` recordings
made elsewhere · `results` the JSON document of a replay or a live run. The only user of mcap.
"""

from imutui.logbook.session_info import SessionInfo

__all__ = ["SessionInfo"]
