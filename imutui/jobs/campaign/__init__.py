"""Many logs: a row of results for each, made on one machine, by a cluster or in shards; a map of the modules.

`rows` the shape of a row, and of the document that holds them.

A fleet: `summary` rows as a summary · `summary_document` its shape · `row_file` how rows come in · `fleet_values`
biases with unit, power-on and time · `summary_channels`, `summary_limits`, `summary_effects`, `summary_parts` what
is told of them
"""
