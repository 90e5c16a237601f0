"""Jobs over logs, as plain functions from files to result records: no printing, no exit codes.

`export`, `apply` (`linear_correction` what it corrects), `info`, `check` (`check_file`, `check_times`, `check_packets`,
`check_samples` its rules, `check_context` what they look at), `recover`, `replay` (`replay_input` its samples, what
stands in for channels that a log lacks, and the samples' own noise; `replay_course`), `trace` (`runs`, `log_motion`
from a log to a run, `residuals` its curves and a log's noise, `run_consistency` whether runs belong together,
`power_ons` those that are parts of one) · `page_data` what a log adds to the page of a result, `driver_curves` what an
error follows · `documents` shapes of what they return, `result_files` those of replay and trace from files,
`quantities` words in it · `operator_steps` a profile for an operator · `investigation` rounds of a table under
command, `investigation_diary` · `log_files` what lies beside a log · `tasks`, `worker`, `parallel` jobs in processes of
their own.
"""
