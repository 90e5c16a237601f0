"""Pages and figures from result records: pure functions, no reading of logs, no judgement of their own.

`sentences` what a trace found, in words   `figures` matplotlib, the only user of it   `page` one HTML file
"""
