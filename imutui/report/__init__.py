"""Pages, figures and text from result records: pure functions, no reading of logs, no judgement of their own.

`trace_glance`, `trace_tables` what a trace found, as blocks that `plain` writes for a terminal · `logs` what `info`,
`check` and `recover` found · `replay_text` what a filter found, for a terminal · `numbers` as people read them,
`effect_words` names of effects · `blocks` what a page consists of, apart from how it is written · `identity`,
`trace_report`, `replay_report` results as such blocks · `comparison` several beside each other · `how_to_apply`,
`data_quality` sections of them · `trace_figures`, `filter_figures`, `comparison_figures`, `axes` what figures show ·
`figures` the only user of matplotlib · `html` a page as one file · `page` the folder to hand over, JSON and PDF in it

A fleet: `fleet_sentences` what its summary says · `fleet_figures`, `fleet_report` its page · `batch_report` the
page of a batch
"""
