"""Layout of the arrays that the runner, the engines and the compiled step share. Plain numbers: nothing to compile.

`core` holds the state and the totals of a run, a row of `known` what is known at a sample, `par` what never changes in
a run but for the noise in force, `sums` a block of the convergence monitor, `moments` the errors after convergence, a
row of `out` one estimate, `extra` and `across` the states beyond the 15, if effects bring some. Covariances have 15
rows of STRIDE.
"""

STRIDE = 16  # row length of the covariance: 15 states and one zero, a multiple of every vector width

# state: latitude, longitude, height, velocity 3, quaternion n←b 4 (w first), accelerometer bias 3, gyro bias 3
NAV = 16
NAV_V, NAV_Q, NAV_BA, NAV_BG = 3, 6, 10, 13

# totals of a run, beside the state
CORE_T, CORE_GYRO, CORE_ACCEL = 16, 17, 20
CORE_NIS_SUM, CORE_NIS_COUNT, CORE_NIS_FIRST, CORE_NIS_LAST, CORE_DOF_LAST = 23, 24, 25, 26, 27
CORE_REJECTED, CORE_IN_A_ROW, CORE_OVERRULED = 28, 29, 30
CORE_SAMPLES, CORE_NEXT_OUT = 31, 32
CORE_SPREAD, CORE_DOF_SUM = 33, 34
CORE_NU = 35  # innovation of the last update, nine rows; NaN where a row was not known
CORE = 44

# what is known at a sample: position, velocity, quaternion, variances of the nine rows (negative: not known), and the
# angular rate and specific force of a perfect unit (NaN: not known)
KNOWN_V, KNOWN_Q, KNOWN_R, KNOWN_RATE, KNOWN_FORCE = 3, 6, 10, 19, 22
KNOWN = 25

# parameters
PAR_PERIOD, PAR_KAPPA, PAR_GRAVITY_ANOMALY, PAR_LINEAR, PAR_EVERY = 0, 1, 2, 3, 4
PAR_NOISE = 5  # squared densities: accel_vrw, gyro_arw, accel_walk, gyro_walk
PAR_GATE = 17  # NIS limit by number of rows, 0..9
PAR_WHITE = 27  # accel_vrw, gyro_arw as set; those of PAR_NOISE are scaled where an effect says so
PAR = 33

# sums over a block of the convergence monitor
SUM_RESIDUAL, SUM_BIAS, SUM_RESIDUALS, SUM_BIASES = 0, 6, 12, 13
SUMS = 14

# running moments of state errors against the reference (Welford)
MOMENT_COUNT, MOMENT_MEAN, MOMENT_SCATTER = 0, 1, 16
MOMENTS = 16 + 15 * 15

# one row of output
OUT_INDEX, OUT_T, OUT_NAV, OUT_NIS, OUT_DOF, OUT_NU, OUT_P = 0, 1, 2, 18, 19, 20, 29
OUT = 29 + 15 * STRIDE

# the p states x beyond the 15, x' = -x/τ + w, in rows of p: x; τ, s; density of w; update and gain of one row; the
# regressor φ at the sample before (6 rows); the share of x in the step's effective bias (6); Cov(z, x) and then that
# times the inverse of z's Cholesky factor (15); Cov(x) (p), and as it was before the update (p). Their covariances with
# the 15 errors, `across`, are p rows of STRIDE, and again as they were before the update.
EXTRA_MEAN, EXTRA_TAU, EXTRA_DENSITY, EXTRA_ERROR, EXTRA_GAIN = 0, 1, 2, 3, 4
EXTRA_BEFORE, EXTRA_SHARE, EXTRA_WHITE, EXTRA_OWN = 5, 11, 17, 32

DONE, INDEFINITE, NOT_FINITE = -1, 1, 2  # why `advance` returned early: `DONE` not at all
