"""Pages, figures and text from result records: pure functions, no reading of logs, no judgement of their own.

`sentences` what a trace found, in words · `logs` what `info`, `check` and `recover` found · `numbers` as people read
them · `figures` matplotlib, the only user of it · `page` one HTML file
"""
