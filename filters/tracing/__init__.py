"""From residual to physical effect: which are there, how sure, what else would do, and the error before and after.

`trace.trace` takes `run.Run`s to a `result.Trace` by these steps, in this order; each takes what the one above made.
Throughout, `design` is the runs at hand with their columns, noise and drift; `channels` are numbers of those with data;
`terms`, `selection` and `chosen` what is selected already; `seed` is of intervals and bands; a `stack` has the rows of
all runs, shape (n, …), SI, instrument axes. Imports: the ground, `filters.motion`, `filters.effects`; never
`filters.simulation`, whose truths it is tested with.

 1 the data     `run` a power-on, or a part of one, with its reference · `residual` reading minus what a perfect unit
                would read
 2 set aside    `screening` faults of the data, colour and correlation of noise · `line_search` lines, sought in what
                effects leave and taken out · `long_run` all of it, piece after piece, of a run too long to be held
 3 averaged     `blocks` means of a quarter of a second · `stack` all runs, cut into cells for folds
 4 hypotheses   `columns` regressors of all that the data can carry, a `Term` each · `whitening` the bias filter over
                residual and regressors, likelihood of drift · `design_matrix` Gram matrices, gains, fits
 5 noise        `noise_level` what its level follows
 6 what can't   `identifiability` effects that these runs can't show · `detectability` the smallest size that a log
   be seen      would show, and what a motion lets be told before it is made
 7 selection    `selection` greedy, on one scale: score = gain - price · `run_specific_search` tones, steps, two-level
                noise, of a channel that drifts too · `beside_drift` whether drift would do as well, fitted on both
                sides · `slow_effects` as rivals of drift and its steps, `evidence` summed over all that is not known,
                `spectrum` the spectra of drift · `left_out_runs` gain on cells that the fit has not seen, whether a
                term carries over · `thermal_forms` curve, memory and drift together, `thermal_memory` where they take
                the place of single effects, and what of them carries over
                `comparison` has 2-7 done: runs at rest lose lines first, of moving ones effects are selected before;
                noise of a measured attitude is judged here
 8 findings     `findings` parameters, channels, rivals: what else would do in a finding's place
 9 common       `common_causes` events and drifts that channels share, whose cause is not in the log · `common_rows`
                residuals in seconds at rest · `common_steps` events · `common_drift` drifts
10 validation   `held_out_run` errors before and after, position error among them · `judgement` what it confirms and
                refutes · `validation` the figures of a channel · `window_filter` what the bias filter foretells of
                windows · `error_figure` the record of one, intervals
11 what next    `candidate_motions` what can be done with a unit · `experiment` which of it separates rivals ·
                `table_motions` what a table under command can do, `planning` what of it tells most for its time
12 assessment   `assessment` steps 8-11 as one frozen record, and a word for each channel
13 report       `trace_document` docs/formats.md as types · `report` the document, curves and their forms · `inclusion`
                what joins the filter · `result` all that a trace gives
"""
