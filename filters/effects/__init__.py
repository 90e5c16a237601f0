"""What may be wrong with a unit: the catalogue of physical effects that the tracer tests and the filter can take in.

`catalogue` names every effect, with its equation and its family; a family is a module:

additive       `deterministic` a sensor's own errors, as data: of temperature, of time, of what it senses (thermal_lin …
               g_squared) · `drivers` where no name is known: free curves over what was logged (driver:NAME) and chains
               of `operators` over it (cause:OPERATOR(NAME))
motion         `deterministic` too: errors of the reference, one parameter over several channels (mounting, earth_rate,
               delay, lever_arm, tilt, gravity), and harmonics of a table's angle
run_specific   `run_specific` what each run has its own of (tone, step, telegraph)
drift          random_walk and gauss_markov have no regressor: they are processes of `filters.tracing.whitening`
noise          `noise` band limit, correlation, whiteness · `lines` tones at the full rate · `spectra` under both
fault          `faults` all of them · `time_stamps` dropout and jitter ·
               `quantisation` steps of readings, size of noise · `fault_records` what the searches share

What they are made of: `hypothesis` what every deterministic effect offers: regressor, parameters, shape · `inputs` what
they are functions of · `plain_names` effects and drivers in words. What the filter takes: `records` effects as files
keep them · `runtime` their regressors from the past alone.

Everything is in the instrument's own axes and sign, SI. Imports: the ground and `filters.motion`, never a filter. What
the simulator applies (`filters.simulation`) is written apart, by each effect's own physics; it takes from here names
and numbers (`inputs`), never a regressor.
"""
