"""Jobs over logs, as plain functions from files to result records: no printing, no exit codes.

`export`, `apply`, `info`, `check` (`check_file`, `check_times`, `check_packets`, `check_samples` its rules,
`check_context` what they look at, `step_counts` steps of time by length),
`recover`, `replay` (`replay_input` its samples, `log_noise`), `trace` (`runs`, `log_motion` from a log to a run,
`residual_curves` its curves, `run_consistency` whether runs belong together, `power_ons` those that are parts of one)
· `unread_filled` readings for a filter where a log lacks channels · `page_data` what a log adds to the page of a
result (`log_quality`, `residual_noise`, `correction_terms`) · `documents` shapes of what they return, `result_files`
those of replay and trace from files, `document_shape` whether they have them, `damage_text`, `quantities` words in it ·
`operator_steps` a profile for an operator · `sidecar_files` what is written beside a log · `tasks`, `worker`,
`parallel` jobs in processes of their own.
"""
