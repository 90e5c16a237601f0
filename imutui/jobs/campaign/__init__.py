"""Many logs: a row of results for each, made on one machine, by a cluster or in shards; a map of the modules.

`rows` the shape of a row, and of the document that holds them · `log_list` which logs there are · `one_log` how they
are to be taken, and the row of a log · `run` the rows that lack, by one way or another: `local` processes of this
machine, `cluster` workers of dask · `results_folder` where they go, also as a table, `stored_rows` how they are read
again · `collect` folders joined.

A fleet: `summary` rows as a summary, its units' limits and effects · `summary_document` its shape · `fleet_values`
biases with unit, power-on and time · `summary_channels` what is told of them

A batch, units of one table: `unit_at_rest` what each shows while it rests · `common_errors` what all show, which is the
table's · `batch` which of them pass
"""
