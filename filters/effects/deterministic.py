"""The catalogue's effects that are functions of time, temperature and motion (1-20), as data.

x is what the channel itself senses, f the specific force, v the rates or the forces, T the temperature in the case, T0
`REFERENCE_DEGC`, T' its rate, t the time since power-on, θ a table angle.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from filters.channels import ACCELS, DPS, GYROS, G
from filters.effects.hypothesis import ALL, Hypothesis, Parameter
from filters.effects.hypothesis import own_parameter as own
from filters.effects.inputs import BANKS, LAGS, NARROW_PLAYS, REFERENCE_DEGC, SENSED, SHORT_LAGS, Inputs
from filters.motion.segments import AXES
from filters.types import Array

WARMUP_TAUS = (40.0, 70.0, 120.0, 200.0, 300.0, 400.0, 600.0, 900.0, 1400.0, 2200.0, 3600.0)

Columns = Callable[[Inputs, int], Array]


def of_sensor(channel: int, from_s: float = 0.0) -> list[Hypothesis]:
    """Return all hypotheses of errors that the sensor of a channel adds, in all their shapes.

    `from_s`: time at which the data begin and where warm-up is anchored, s since power-on.
    """
    others = [only for only in range(-1, 3) if only != channel % 3]
    return [
        *(make(channel) for make in (thermal_lin, thermal_rate, ramp, scale, asymmetry, nonlinearity_cubic)),
        *([nonlinearity_quadratic(channel)] if channel in GYROS else []),
        thermal_scale(channel),
        *(cross_axis(channel, only) for only in others),
        *(g_sensitivity(channel, only) for only in range(-1, 3) if channel in GYROS),
        *(thermal_poly(channel, order) for order in (2, 3)),
        *(thermal_lag(channel, lag) for lag in range(len(LAGS))),
        *(hysteresis(channel, bank) for bank in range(len(BANKS))),
        *(warmup(channel, tau, from_s) for tau in WARMUP_TAUS),
        *(g_squared(channel, axis) for axis in range(3)),
        delay((channel,)),
    ]


def harmonics(channel: int) -> list[Hypothesis]:
    """Harmonics of the table's angles on a channel."""
    return [harmonic(channel, axis, order) for axis in range(3) for order in (1, 2)]


def shared() -> list[Hypothesis]:
    """Errors of the reference, or of the whole unit or a triad, whose parameters several channels share."""
    whole = [mounting(), earth_rate(), delay(), lever_arm(), tilt(), gravity()]
    return whole + [of(triad) for of in (mounting, delay) for triad in (GYROS, ACCELS)]


# ---------------------------------------------------------------------------------------------- temperature and time


def _slow(effect: str, source: str, channel: int, columns: Columns, *own: Parameter, **more: Any) -> Hypothesis:
    needs = ("temperature",) if source == "temperature" else ()
    return Hypothesis(
        effect=effect, channels=(channel,), source=source, parameters=own, columns=columns, is_everywhere=True,
        **{"needs": needs, **more},
    )  # fmt: skip


def thermal_lin(channel: int) -> Hypothesis:
    """e = k (T - T0)."""
    k = own(channel, "k", "/K", 0.02, 0.3)
    return _slow("thermal_lin", "temperature", channel, _powers(1), k, rank=0, over=("temperature",))


def thermal_poly(channel: int, order: int = 2) -> Hypothesis:
    """e = k1 dT + k2 dT² (+ k3 dT³), dT = T - T0."""
    priors = (("/K", 0.02, 0.3), ("/K2", 1e-3, 0.015), ("/K3", 2e-5, 3e-4))
    ks = (own(channel, f"k{n}", *of) for n, of in enumerate(priors[:order], 1))
    more: Any = {"shape": {"order": float(order)}, "grid": 2, "rank": 13, "over": ("temperature",)}
    return _slow("thermal_poly", "temperature", channel, _powers(order), *ks, **more)


def _powers(order: int) -> Columns:
    return lambda u, c: (u.temperature - REFERENCE_DEGC)[:, None] ** np.arange(1, order + 1)


def thermal_rate(channel: int) -> Hypothesis:
    """e = k T'."""
    k = own(channel, "k", "/(K/s)", 1.0, 15.0)
    more: Any = {"rank": 5, "over": ("temperature_rate",)}
    return _slow("thermal_rate", "temperature", channel, lambda u, c: u.temperature_rate[:, None], k, **more)


def thermal_lag(channel: int, lag: int = 0) -> Hypothesis:
    """e = k (T_tau - T), T_tau following T as a first-order lag does, from equality at power-on."""
    k, wide = own(channel, "k", "/K", 0.02, 0.3), lag >= SHORT_LAGS
    more: Any = {"shape": {"tau_s": LAGS[lag]}, "grid": len(LAGS) if wide else SHORT_LAGS, "rank": 6, "is_wide": wide}
    return _slow(
        "thermal_lag", "temperature", channel, lambda u, c: (u.lagged[:, lag] - u.temperature)[:, None], k, **more
    )


def hysteresis(channel: int, bank: int = 0) -> Hypothesis:
    """e = k · mean of P_n(T - T(0)) / width over a bank of play operators; `start` where in its band each began."""
    (width, start), wide = BANKS[bank], bank >= NARROW_PLAYS
    shape = {"width_k": width} if start == 0.0 else {"width_k": width, "start": start}
    more: Any = {"shape": shape, "grid": len(BANKS) if wide else NARROW_PLAYS, "rank": 14, "is_wide": wide}
    k, columns = own(channel, "k", "", 0.3, 5.0), lambda u, c: u.plays[:, bank, None]
    return _slow("hysteresis", "temperature", channel, columns, k, **more)


def warmup(channel: int, tau: float = WARMUP_TAUS[0], from_s: float = 0.0) -> Hypothesis:
    """e = k exp(-max(t - t0, 0)/tau).

    `from_s`: t0, s since power-on. It is where the data begin, so `k` is the error there. The law is constant before
      t0: data that begin late do not determine how much larger the error was earlier.
    """
    k, shape = own(channel, "k", "", 0.2, 3.0), {"tau_s": tau} | ({"from_s": from_s} if from_s else {})
    columns = lambda u, c: np.exp(-np.maximum(u.t - from_s, 0.0) / tau)[:, None]  # noqa: E731
    more: Any = {"shape": shape, "grid": len(WARMUP_TAUS), "rank": 3, "over": ("time",)}
    return _slow("warmup", "time", channel, columns, k, **more)


def ramp(channel: int) -> Hypothesis:
    """e = k t."""
    k = own(channel, "k", "/s", 1e-5, 1.5e-4)
    return _slow("ramp", "time", channel, lambda u, c: u.t[:, None], k, rank=4, over=("time",))


def bias(channel: int) -> Hypothesis:
    """e = b: found of units turned by hand only; elsewhere the constant bias is what effects are looked for beside."""
    return _slow("bias", "time", channel, lambda u, c: np.ones((len(u.x), 1)), own(channel, "b", "", 1.0, 12.0))


# ------------------------------------------------------------------------------------------------------------- motion


def _of_motion(effect: str, channel: int, columns: Columns, *own: Parameter, **more: Any) -> Hypothesis:
    of: dict[str, Any] = {"over": (SENSED[channel],), **more}
    return Hypothesis(
        effect=effect, channels=(channel,), source="motion", parameters=own, columns=columns, **of
    )  # fmt: skip


def scale(channel: int) -> Hypothesis:
    """e = k x."""
    return _of_motion("scale", channel, lambda u, c: u.x[:, c, None], Parameter("k", "1", 1.0, 0.01), rank=1)


def asymmetry(channel: int) -> Hypothesis:
    """e = k abs(x)."""
    k = Parameter("k", "1", 1.0, 3e-3)
    return _of_motion("asymmetry", channel, lambda u, c: np.abs(u.x[:, c, None]), k, rank=8)


def nonlinearity_cubic(channel: int) -> Hypothesis:
    """e = k x³; plausible are .3 % of full scale (200 deg/s) and 1 % (4 g)."""
    unit, si = ("/(deg/s)3", DPS) if channel in GYROS else ("/g3", G)
    k = own(channel, "k", unit, 7.5e-8, 0.6, si**3)
    return _of_motion("nonlinearity_cubic", channel, lambda u, c: u.x[:, c, None] ** 3, k, rank=10)


def nonlinearity_quadratic(channel: int) -> Hypothesis:
    """e = k ω² of a gyro; an accelerometer's own f² is g_squared."""
    k = own(channel, "k", "/(deg/s)2", 1.5e-5, 0.0, DPS**2)
    return _of_motion("nonlinearity_quadratic", channel, lambda u, c: u.x[:, c, None] ** 2, k, rank=9)


def thermal_scale(channel: int) -> Hypothesis:
    """e = k x (T - T0); of an input that never varies it is a bias that follows temperature."""
    k, needs = Parameter("k", "1/K", 1.0, 2e-4), ("temperature", SENSED[channel])

    def columns(u: Inputs, c: int) -> Array:
        return (u.x[:, c] * (u.temperature - REFERENCE_DEGC))[:, None]

    return _of_motion("thermal_scale", channel, columns, k, rank=15, needs=needs, over=())


def cross_axis(channel: int, only: int = -1) -> Hypothesis:
    """e = sum of k_j x_j over the sensors of the same kind on the other axes, or one of them alone."""
    first = 3 * (channel // 3)
    others = [j for j in range(first, first + 3) if j != channel and only in (-1, j % 3)]
    more: Any = {"shape": {"axes": "".join("xyz"[j % 3] for j in others)}, "over": tuple(SENSED[j] for j in others)}
    ks = (Parameter("xyz"[j % 3], "rad", 1.0, 0.01) for j in others)
    return _of_motion("cross_axis", channel, lambda u, c: u.x[:, others], *ks, grid=3, rank=2, **more)


def g_sensitivity(channel: int, only: int = -1) -> Hypothesis:
    """e = G · f of a gyro, f as the accelerometers read it; all of G, or along one axis alone."""
    axes = [j for j in range(3) if only in (-1, j)]
    more: Any = {
        "shape": {"axes": "".join("xyz"[j] for j in axes)}, "over": tuple(SENSED[3 + j] for j in axes),
        "grid": 4, "rank": 7, "is_everywhere": True,
    }  # fmt: skip
    ks = (Parameter("xyz"[j], "deg/s/g", DPS / G, 0.05) for j in axes)
    forces = [3 + j for j in axes]
    return _of_motion("g_sensitivity", channel, lambda u, c: u.x[:, forces], *ks, **more)


def g_squared(channel: int, axis: int = 0) -> Hypothesis:
    """e = k f_j²: vibration rectification, or an accelerometer's own quadratic term."""
    more: Any = {
        "shape": {"axis": "xyz"[axis]}, "over": (SENSED[3 + axis],), "grid": 3, "rank": 11, "is_everywhere": True,
        "words": f"bias follows the square of specific force along {'xyz'[axis]}",
    }  # fmt: skip
    k = own(channel, "k", "/g2", 0.02, 3.0, G**2)
    return _of_motion("g_squared", channel, lambda u, c: u.x[:, 3 + axis, None] ** 2, k, **more)


def harmonic(channel: int, axis: int = 0, order: int = 1) -> Hypothesis:
    """e = a sin(h θ) + b cos(h θ) of a table angle: magnetic field, wobble of an axis."""

    def columns(u: Inputs, c: int) -> Array:
        angle = order * u.angles[:, axis]
        return np.stack([np.sin(angle), np.cos(angle)], axis=1)

    name = AXES[axis]
    more: Any = {
        "shape": {"axis": name, "order": float(order)}, "words": f"{name} {order}/rev", "grid": 6, "rank": 12,
        "needs": (name,), "over": (f"angle_{name}",), "is_everywhere": True,
    }  # fmt: skip
    return _of_motion("harmonic", channel, columns, *(own(channel, k, "", 0.05, 2.0) for k in ("sin", "cos")), **more)


# ---------------------------------------------------------------------------------------- of the reference or the unit


def _shared(effect: str, channels: tuple[int, ...], columns: Columns, *own: Parameter, **more: Any) -> Hypothesis:
    return Hypothesis(effect=effect, channels=channels, source="motion", parameters=own, columns=columns, **more)


def mounting(channels: tuple[int, ...] = ALL) -> Hypothesis:
    """e = v × d, v = ω and f with the same d: the sensors are turned in their case; or those of one triad alone."""

    def columns(u: Inputs, c: int) -> Array:
        v = u.x[:, :3] if c < 3 else u.x[:, 3:]
        return np.cross(v[:, None, :], np.eye(3)[None])[:, :, c % 3]

    d = (Parameter(x, "rad", 1.0, 0.01) for x in "xyz")
    return _shared("mounting", channels, columns, *d, follows_rates=True, grid=_choices(channels))


def earth_rate() -> Hypothesis:
    """e = k C ω_ie in a residual that contains Earth rate: -1 for a unit, or a model, without it."""
    return _shared("earth_rate", GYROS, lambda u, c: u.spin[:, c, None], Parameter("k", "1", 1.0, 1.0))


def delay(channels: tuple[int, ...] = ALL) -> Hypothesis:
    """e = -tau x', of all channels, of one triad, or of one channel."""
    tau, columns = Parameter("tau", "s", 1.0, 5e-3), lambda u, c: -u.x_dot[:, c, None]
    return _shared("delay", channels, columns, tau, follows_rates=True, grid=_choices(channels))


def _choices(channels: tuple[int, ...]) -> int:
    """How many sets of channels there are to choose from, down to those of this size: all, triads, single ones."""
    return {len(ALL): 1, len(GYROS): 3}.get(len(channels), 9)


def lever_arm() -> Hypothesis:
    """e = ω × (ω × r) + ω' × r."""
    r = (Parameter(x, "m", 1.0, 0.05) for x in "xyz")
    return _shared("lever_arm", ACCELS, lambda u, c: u.centripetal[:, c - 3], *r, follows_rates=True)


def tilt() -> Hypothesis:
    """e = C (δ × (0, 0, -γ)): the base of the table is not level."""
    angles = (Parameter(x, "deg", DPS, 0.05) for x in ("north", "east"))
    return _shared("tilt", ACCELS, lambda u, c: u.horizontal[:, c - 3], *angles)


def gravity() -> Hypothesis:
    """e = k C (0, 0, -γ): equals a common scale factor of the accelerometers."""
    return _shared("gravity", ACCELS, lambda u, c: u.x[:, c, None], Parameter("k", "1", 1.0, 1e-4))


def common_scale() -> Hypothesis:
    """One scale factor of all accelerometers: the columns of gravity, whose rival it is; never selected itself."""
    k, words = Parameter("k", "1", 1.0, 1e-4), "accelerometers have a common scale factor"
    return _shared("scale", ACCELS, lambda u, c: u.x[:, c, None], k, words=words)
