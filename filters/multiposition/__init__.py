"""Units turned by hand between rests, without a table: what gravity alone shows of accelerometers and gyros.

`rests`          where the unit rests, from the readings themselves
`triad`          three sensors as what is true and effects of the catalogue
`least_squares`  fits with an error of the model beside the noise
`accelerometer`  bias, scale, misalignment: every rest has gravity's magnitude
`turns`          gyros: the integrated rate turns one rest's gravity into the next one's
`choice`         which effects the data ask for
`calibration`    all of these in order, and errors before and after: rests left out, or on another log
`carry_over`     what is the unit's, and what differs from power-on to power-on
`report`         all of it as a trace: findings, what a held-out log says, rivals, statuses, what joins the filter
"""
