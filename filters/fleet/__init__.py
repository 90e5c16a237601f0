"""Many units, many power-ons: what of a value is the unit's own, what its model's, and what only this day's.

Values come with known standard deviations, as a filter gives them for biases and a trace for parameters of effects, in
any unit. numpy and scipy only: nothing here is compiled, no file is read.

`readings` values of logs as one value a power-on · `grid`, `mixture` integration over components of variance ·
`components` their restricted likelihood; model, unit and day with intervals · `drift` values of units over time and
temperature, which units drift, Holm's correction · `control_chart` which power-ons fall out

Statsmodels' mixed models take no known variances of measurement, beside which the components are estimated; hence the
likelihood here, which nesting makes a sum over units.
"""
