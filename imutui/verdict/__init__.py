"""The verdict on a filter: `rules` judge the record of what it has come to, `sources` word the verdict on a result.

Badge, `stop`, `replay`, `record`, result pages and exit codes take it from here, so that no two contradict each other.
"""
