"""What may be wrong with a unit: the catalogue of physical effects that the tracer tests and the filter can take in.

`inputs`      what the effects are functions of, at some instants of a run
`additive`    a sensor's own errors: temperature, time, what it senses (thermal_lin … g_squared)
`reference_errors`      errors of the reference, one parameter over several channels (delay, lever_arm, tilt, gravity,
…) `drivers`     free curves over anything that was logged, where the physics has no name (driver:NAME)
`stochastic`  drift that nothing logged drives (random_walk, gauss_markov)
`noise`       level, bandwidth and correlation of the noise    `lines` tones at the full rate    `faults` data faults

Everything is in the instrument's own axes and sign, SI. What the simulator applies (`filters.simulation`) is written
apart from it, by each effect's own physics: neither imports the other.
"""
