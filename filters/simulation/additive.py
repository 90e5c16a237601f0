"""Errors that a sensor adds by itself, each a known function of what it senses, of temperature, and of time.

x is what the channel itself senses (without errors), T the temperature inside the case, T' its rate, t the time since
power-on, all in the instrument's axes and sign. e is the error, in dps or mg by the channel.
"""

import math
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from filters.channels import CHANNELS, DPS, G
from filters.effects.inputs import PLAYS, REFERENCE_DEGC
from filters.errors import InputError
from filters.first_order import first_order
from filters.motion.segments import AXES
from filters.simulation.parameters import GYRO_CHANNELS, ScenarioParameter, Setup, TrueInputs, positive
from filters.types import Array

_REFERENCE = ScenarioParameter("reference", "reference_degc", REFERENCE_DEGC)


@runtime_checkable
class Additive(Protocol):
    """An error of one channel, over successive stretches of readings."""

    def error(self, inputs: TrueInputs) -> Array:
        """Error of the next readings, rad/s or m/s², shape (N,)."""
        ...


class ThermalLin:
    """e = k (T - T0); `{e}_per_k`, `reference_degc` (25)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_k"), _REFERENCE)

    def __init__(self, setup: Setup) -> None:
        self._k, self._reference = setup.number("k"), setup.number("reference")

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * (inputs.temperature - self._reference)


class ThermalPoly:
    """e = k1 dT + k2 dT² + k3 dT³, dT = T - T0.

    `{e}_per_k` (0), `{e}_per_k2`, `{e}_per_k3` (0), `reference_degc` (25).
    """

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (
        ScenarioParameter("k1", "{e}_per_k", 0.0),
        ScenarioParameter("k2", "{e}_per_k2"),
        ScenarioParameter("k3", "{e}_per_k3", 0.0),
        _REFERENCE,
    )

    def __init__(self, setup: Setup) -> None:
        self._k = [setup.number(key) for key in ("k1", "k2", "k3")]
        self._reference = setup.number("reference")

    def error(self, inputs: TrueInputs) -> Array:
        d = inputs.temperature - self._reference
        k1, k2, k3 = self._k
        return ((k3 * d + k2) * d + k1) * d


class ThermalRate:
    """e = k T'; `{e}_s_per_k`, that is per K/s."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_s_per_k"),)

    def __init__(self, setup: Setup) -> None:
        self._k = setup.number("k")

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.temperature_rate


class ThermalLag:
    """e = k (T_τ - T), T_τ following T as a first-order lag does, from equality at power-on; `{e}_per_k`, `tau_s`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_k"), positive("tau", "tau_s"))

    def __init__(self, setup: Setup) -> None:
        self._k = setup.number("k")
        self._pole = math.exp(-1.0 / (setup.rate_hz * setup.number("tau")))
        self._memory: float | None = None

    def error(self, inputs: TrueInputs) -> Array:
        if self._memory is None:
            self._memory = self._pole * float(inputs.temperature[0])
        lagged, self._memory = first_order(inputs.temperature, 1.0 - self._pole, self._pole, self._memory)
        return self._k * (lagged - inputs.temperature)


class Hysteresis:
    """e = k · mean over n of P_n(T - T(0)) / width: six play operators P_n, n = 1 … 6, of half-widths n width / 6.

    A play operator moves with its input but for a free stretch of twice its half-width:
    P(k) = min(max(P(k - 1), u(k) - r), u(k) + r), P = 0 at power-on. `{e}` (per `width_k` of travel), `width_k` (10).
    """

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("width", "width_k", 10.0))

    def __init__(self, setup: Setup) -> None:
        width = setup.number("width")
        self._k = setup.number("k") / (width * PLAYS)
        self._half_widths = width * np.arange(1, PLAYS + 1)[:, None] / PLAYS
        self._plays = np.zeros((PLAYS, 1))
        self._start = self._last = math.nan

    def error(self, inputs: TrueInputs) -> Array:
        if math.isnan(self._start):
            self._start = float(inputs.temperature[0])
            self._last = 0.0
        u = inputs.temperature - self._start
        # while its input runs one way a play operator has no history but its place at the beginning
        way = np.sign(np.diff(u, prepend=self._last))
        self._last = float(u[-1])
        out = np.empty(u.size)
        ends = [*(np.flatnonzero(np.diff(way)) + 1).tolist(), u.size]
        for begin, end in zip([0, *ends], ends, strict=False):
            run = u[begin:end]
            path = np.minimum(np.maximum(self._plays, run - self._half_widths), run + self._half_widths)
            self._plays = path[:, -1:]
            out[begin:end] = path.sum(axis=0)
        return self._k * out


class Warmup:
    """e = k exp(-t/τ); `{e}`, `tau_s`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("tau", "tau_s"))

    def __init__(self, setup: Setup) -> None:
        self._k, self._tau = setup.number("k"), setup.number("tau")

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * np.exp(-inputs.t / self._tau)


class Ramp:
    """e = k t; `{e}_per_s`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_s"),)

    def __init__(self, setup: Setup) -> None:
        self._k = setup.number("k")

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.t


class Scale:
    """e = k x; `relative`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def __init__(self, setup: Setup) -> None:
        self._k, self._channel = setup.number("k"), setup.channel

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.perfect[:, self._channel]


class Asymmetry:
    """e = k abs(x); `relative`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def __init__(self, setup: Setup) -> None:
        self._k, self._channel = setup.number("k"), setup.channel

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * np.abs(inputs.perfect[:, self._channel])


class NonlinearityCubic:
    """e = k x³; `{e}_per_{x}3`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_{x}3", inputs=-3),)

    def __init__(self, setup: Setup) -> None:
        self._k, self._channel = setup.number("k"), setup.channel

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.perfect[:, self._channel] ** 3


class NonlinearityQuadratic:
    """e = k ω² of a gyro (an accelerometer's is g_squared); `dps_per_dps2`."""

    channels: ClassVar = GYRO_CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_{x}2", inputs=-2),)

    def __init__(self, setup: Setup) -> None:
        self._k, self._channel = setup.number("k"), setup.channel

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.perfect[:, self._channel] ** 2


class ThermalScale:
    """e = k x (T - T0); `relative_per_k`, `reference_degc` (25)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "relative_per_k"), _REFERENCE)

    def __init__(self, setup: Setup) -> None:
        self._k, self._reference, self._channel = setup.number("k"), setup.number("reference"), setup.channel

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.perfect[:, self._channel] * (inputs.temperature - self._reference)


class CrossAxis:
    """e = sum of k_j x_j over the sensors of the same kind on the other axes; `x_rad`, `y_rad`, `z_rad` (0 each)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_rad", 0.0) for axis in "xyz")

    def __init__(self, setup: Setup) -> None:
        own = setup.channel % 3
        self._k = np.array([setup.number(axis) for axis in "xyz"])
        if self._k[own] != 0.0:
            name = CHANNELS[setup.channel]
            raise InputError(f"`{'xyz'[own]}_rad` is {self._k[own]:g} on {name}: that is its own axis, a scale factor")
        self._inputs = slice(0, 3) if setup.channel < 3 else slice(3, 6)

    def error(self, inputs: TrueInputs) -> Array:
        return _weighted(self._k, inputs.perfect[:, self._inputs])


class GSensitivity:
    """e = G · f of a gyro, f as the accelerometers read it; `x_dps_per_g`, `y_dps_per_g`, `z_dps_per_g` (0 each)."""

    channels: ClassVar = GYRO_CHANNELS
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_dps_per_g", 0.0, factor=DPS / G) for axis in "xyz")

    def __init__(self, setup: Setup) -> None:
        self._k = np.array([setup.number(axis) for axis in "xyz"])

    def error(self, inputs: TrueInputs) -> Array:
        return _weighted(self._k, inputs.perfect[:, 3:6])


class GSquared:
    """e = k f_j²; `{e}_per_g2`, `axis` x, y or z (the channel's own)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (
        ScenarioParameter("k", "{e}_per_g2", factor=G**-2),
        ScenarioParameter("axis", "axis", "own", choices=("own", "x", "y", "z")),
    )

    def __init__(self, setup: Setup) -> None:
        axis = setup.word("axis")
        self._k = setup.number("k")
        self._column = 3 + (setup.channel % 3 if axis == "own" else "xyz".index(axis))

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * inputs.perfect[:, self._column] ** 2


class Harmonic:
    """e = a sin(h θ) + b cos(h θ) of a table angle; `sin_{e}`, `cos_{e}` (0 each), `order` h (1), `axis` (inner)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (
        ScenarioParameter("a", "sin_{e}", 0.0),
        ScenarioParameter("b", "cos_{e}", 0.0),
        positive("order", "order", 1.0),
        ScenarioParameter("axis", "axis", "inner", choices=AXES),
    )

    def __init__(self, setup: Setup) -> None:
        self._a, self._b, self._order = (setup.number(key) for key in ("a", "b", "order"))
        self._axis = AXES.index(setup.word("axis"))

    def error(self, inputs: TrueInputs) -> Array:
        angle = self._order * inputs.angles[:, self._axis]
        return self._a * np.sin(angle) + self._b * np.cos(angle)


class Tone:
    """e = k sin(2π f t + φ), a line of vibration; `{e}`, `hz`, `phase_rad` (drawn from the power-on)."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (
        ScenarioParameter("k", "{e}"),
        positive("hz", "hz"),
        ScenarioParameter("phase", "phase_rad", math.inf),
    )

    def __init__(self, setup: Setup) -> None:
        self._k, self._omega = setup.number("k"), 2.0 * math.pi * setup.number("hz")
        drawn, phase = setup.rng.uniform(0.0, 2.0 * math.pi), setup.number("phase")
        self._phase = phase if math.isfinite(phase) else drawn

    def error(self, inputs: TrueInputs) -> Array:
        return self._k * np.sin(self._omega * inputs.t + self._phase)


class Step:
    """e = k from t0 on; `{e}`, `at_s`."""

    channels: ClassVar = CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}"), ScenarioParameter("at", "at_s", least=0.0))

    def __init__(self, setup: Setup) -> None:
        self._k, self._at = setup.number("k"), setup.number("at")

    def error(self, inputs: TrueInputs) -> Array:
        return np.where(inputs.t >= self._at, self._k, 0.0)


def _weighted(weights: Array, columns: Array) -> Array:
    return np.asarray(weights[0] * columns[:, 0] + weights[1] * columns[:, 1] + weights[2] * columns[:, 2])
