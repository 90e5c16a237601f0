"""Inertial estimation: the conventions page that everything else refers to.

What this package is for: the filters that turn rates and specific forces of an IMU on a turn table into six biases with
honest standard deviations. What it leaves out: files, clocks, threads, printing, instruments. Random numbers come
from generators that the caller seeds.

Frames
    n   navigation: north, east, down (NED) at the site, WGS-84.
    b   body: the table's own axes at zero angles, x north, y east, z down; right-handed.
    i   instrument: the axes and the sign printed on the unit. Only `filters.imu.AxisMap` knows it.
    ``C_nb`` takes body components to navigation components: ``v_n = C_nb @ v_b``.

Signs
    Specific force f = a - g: a still, level unit has f_n = (0, 0, -gamma), gamma being local normal gravity (WGS-84,
    or what the user gives). f_b = s · M · reading, with s the accelerometer sign (-1 for a unit that reads +1 g on Z
    when level, Z down) and M the mounting, a signed permutation from instrument to body axes; rates are M · reading.
    Corrected reading = reading - bias, in the instrument's axes: b_reading = s · Mᵀ · b_f.
    Angular rate follows the right-hand rule: seen from above, clockwise is positive about z (down).

Attitude
    The filter's attitude error ε is a rotation vector in n: C_nb ← exp(ε) C_nb. Innovation: Log(C_ref Ĉᵀ).
    A table with axes outer (north), middle (east), inner (down) has C_nb = Rx(outer) Ry(middle) Rz(inner).
    Roll, pitch, yaw (3-2-1, C_nb = Rz(yaw) Ry(pitch) Rx(roll)) are for display.

Units
    SI and radians throughout; a number in another unit has the unit in its name. 1 g = 9.80665 m/s² where a
    reading is in g (`filters.imu.STANDARD_GRAVITY`). Latitude and longitude in radians, height in metres.

State (order of the 15 errors, `filters.state`)
    position δp_n (m), velocity δv_n (m/s), attitude ε_n (rad), accelerometer bias δb_a (m/s²), gyro bias δb_g (rad/s),
    north, east, down or body x, y, z. Effects that join the filter (`filters.kalman.augmentation`) add p states x after
    them: reading - b - φ x is what is integrated; φ (6, p) is accelerometer then gyro, body x, y, z.

Names
    innovation   reference minus predicted state, before the update       residual   sensor minus reference
    NIS, NEES    normalised innovation, estimation error squared          ``_sd``    standard deviation
    arw, vrw     angle and velocity random walk: densities of white noise, rad/√s and m/s/√s

Where things are
    Ground: `errors` what an input can cause; any other exception is a defect · `channels` names, order and units of
    the six readings · `earth` radii, gravity, Earth rate · `attitude` rotations · `specification` what data sheets
    promise · `imu` samples, axes, noise · `state` the navigation state and the order of the errors · `allan` white
    noise and drift of a log · `first_order` the recursion of lags and of band limits · `compilation` by numba.

    `motion`      what is known of it: `segments`, `kinematics` and `profile`, what a table does · `reference` what the
                  filter is fed · `alignment` how that is found in data
    `kalman`      the filters: `strapdown` equations (1)-(5) · `spkf` the filter, (11)-(15), to be read; `kernels` the
                  same step, compiled · `augmentation` effects as further states and noise · `spkf_paper` the paper's
                  own form, `ekf` (6)-(10) · `engines` what turns samples into estimates; `layout` its arrays,
                  `filter_input` what they take · `settings`, `rows`, `runner` a run, one sample or many · `long_gap`
                  biases without a reference · `consistency` NIS, noise, convergence · `alarms` what contradicts it
    `effects`     the catalogue of what may be wrong with a unit
    `simulation`  units with known truth, and the table that they stand on
    `tracing`     from residual to effect; its docstring has the steps in order
    `fleet`       many units and power-ons: what is the unit's own, its model's, and the day's
    `multiposition`  a unit turned by hand between rests: calibrated from gravity alone

Residual and effects
    residual = reading - what a perfect unit would read there, in the instrument's own axes and sign: an effect e is an
    error of the reading, e = φ θ, and the same φ screens residuals and joins the filter, where b_eff = b + φ x. A run
    is one power-on, with constant biases of its own. What is found is judged on a run that nothing was fitted to.

Measurements of the reference
    exact        the known state itself is fed: a table at rest is known; NIS is then no test
    drawn        with noise of covariance R, from a counter-based generator: NIS and NEES are chi-square
    Rows of R (10 m, 10 m, 30 m; 0.1 m/s; 0.1°, 0.1°, 0.5°) belong to north, east, down. P0 of the navigation states is
    R, of biases (18 mg, 1.5 deg/s)². Q is white noise of Table 1 times dt and constant biases, unless measured.

Readings between samples
    A unit at rest: a sample is held over the step that it ends. A unit that may move: linear from sample to sample.
    Across a gap a held sample's noise adds up coherently, and the angle it may have turned unseen is added.

Source: H. K. Kuga, R. V. F. Lopes, W. Einwoegerer, "Experimental static calibration of an IMU based on MEMS", whose
equation numbers (1)-(15) and tables 1-3 the docstrings cite. Misprints corrected: P in (10) is (I - KH) P, here in
Joseph's form; Q_d is added in (15); sigma points are columns of the lower Cholesky factor in (11); differences to the
centre point are averaged in (14); (13) integrates from t_k to t_{k+1} with the measured input.
"""
