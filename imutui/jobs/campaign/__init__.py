"""Many logs: a row of results for each, made on one machine, by a cluster or in shards; a map of the modules.

`rows` the shape of a row, and of the document that holds them.
"""
