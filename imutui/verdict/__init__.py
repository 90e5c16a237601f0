"""The verdict on a filter: `rules` judge a standing, `sources` make one of a snapshot or of a result document.

Badge, `stop`, `replay`, `record`, result pages and exit codes have it from here, so that none says what another denies.
"""
