"""Errors that a sensor adds by itself, each a known function of what it senses, of temperature, and of time.

x is what the channel itself senses (without errors), T the temperature inside the case, T' its rate, t the time since
power-on, all in the instrument's axes and sign. e is the error, in dps or mg by the channel.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from filters.channels import CHANNELS, DPS, G
from filters.effects.inputs import PLAYS, REFERENCE_DEGC
from filters.errors import InputError
from filters.first_order import first_order
from filters.motion.segments import AXES
from filters.simulation.parameters import GYRO_CHANNELS, EffectKind, ScenarioParameter, Setup, TrueInputs, positive
from filters.types import Array

_REFERENCE = ScenarioParameter("reference", "reference_degc", REFERENCE_DEGC)


class Additive(EffectKind):
    """An error of one channel, over successive stretches of readings."""

    @abstractmethod
    def error(self, inputs: TrueInputs) -> Array:
        """Error of the next readings, rad/s or m/s², shape (N,)."""

    def own(self, inputs: TrueInputs) -> Array:
        """x, what the channel itself senses, shape (N,)."""
        return inputs.perfect[:, self.channel]

    def warmer(self, inputs: TrueInputs) -> Array:
        """T - T0, K, shape (N,)."""
        return inputs.temperature - self.number("reference")


class ThermalLin(Additive):
    """e = k (T - T0); `{e}_per_k`, `reference_degc` (25)."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_k"), _REFERENCE)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * self.warmer(inputs)


class ThermalPoly(Additive):
    """e = k1 dT + k2 dT² + k3 dT³, dT = T - T0.

    `{e}_per_k` (0), `{e}_per_k2`, `{e}_per_k3` (0), `reference_degc` (25).
    """

    parameters: ClassVar = (
        ScenarioParameter("k1", "{e}_per_k", 0.0),
        ScenarioParameter("k2", "{e}_per_k2"),
        ScenarioParameter("k3", "{e}_per_k3", 0.0),
        _REFERENCE,
    )

    def error(self, inputs: TrueInputs) -> Array:
        d = self.warmer(inputs)
        k1, k2, k3 = (self.number(key) for key in ("k1", "k2", "k3"))
        return ((k3 * d + k2) * d + k1) * d


class ThermalRate(Additive):
    """e = k T'; `{e}_s_per_k`, that is per K/s."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}_s_per_k"),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * inputs.temperature_rate


class ThermalLag(Additive):
    """e = k (T_τ - T), T_τ following T as a first-order lag does, from equality at power-on; `{e}_per_k`, `tau_s`."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_k"), positive("tau", "tau_s"))

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._pole = math.exp(-1.0 / (setup.rate_hz * setup.number("tau")))
        self._memory: float | None = None

    def error(self, inputs: TrueInputs) -> Array:
        if self._memory is None:
            self._memory = self._pole * float(inputs.temperature[0])
        lagged, self._memory = first_order(inputs.temperature, 1.0 - self._pole, self._pole, self._memory)
        return self.number("k") * (lagged - inputs.temperature)


class Hysteresis(Additive):
    """e = k · mean over n of P_n(T - T(0)) / width: six play operators P_n, n = 1 … 6, of half-widths n width / 6.

    A play operator moves with its input but for a free stretch of twice its half-width:
    P(k) = min(max(P(k - 1), u(k) - r), u(k) + r), P = 0 at power-on. `{e}` (per `width_k` of travel), `width_k` (10).
    """

    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("width", "width_k", 10.0))

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
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


class Warmup(Additive):
    """e = k exp(-t/τ); `{e}`, `tau_s`."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("tau", "tau_s"))

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * np.exp(-inputs.t / self.number("tau"))


class Ramp(Additive):
    """e = k t; `{e}_per_s`."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_s"),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * inputs.t


class Scale(Additive):
    """e = k x; `relative`."""

    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * self.own(inputs)


class Asymmetry(Additive):
    """e = k abs(x); `relative`."""

    parameters: ClassVar = (ScenarioParameter("k", "relative"),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * np.abs(self.own(inputs))


class NonlinearityCubic(Additive):
    """e = k x³; `{e}_per_{x}3`."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_{x}3", inputs=-3),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * self.own(inputs) ** 3


class NonlinearityQuadratic(Additive):
    """e = k ω² of a gyro (an accelerometer's is g_squared); `dps_per_dps2`."""

    channels: ClassVar = GYRO_CHANNELS
    parameters: ClassVar = (ScenarioParameter("k", "{e}_per_{x}2", inputs=-2),)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * self.own(inputs) ** 2


class ThermalScale(Additive):
    """e = k x (T - T0); `relative_per_k`, `reference_degc` (25)."""

    parameters: ClassVar = (ScenarioParameter("k", "relative_per_k"), _REFERENCE)

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * self.own(inputs) * self.warmer(inputs)


class CrossAxis(Additive):
    """e = sum of k_j x_j over the sensors of the same kind on the other axes; `x_rad`, `y_rad`, `z_rad` (0 each)."""

    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_rad", 0.0) for axis in "xyz")

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        own = "xyz"[setup.channel % 3]
        if self.number(own) != 0.0:
            name = CHANNELS[setup.channel]
            raise InputError(f"`{own}_rad` is {self.number(own):g} on {name}: that is its own axis, a scale factor")

    def error(self, inputs: TrueInputs) -> Array:
        return _weighted(self.number, inputs.perfect[:, :3] if self.channel < 3 else inputs.perfect[:, 3:])


class GSensitivity(Additive):
    """e = G · f of a gyro, f as the accelerometers read it; `x_dps_per_g`, `y_dps_per_g`, `z_dps_per_g` (0 each)."""

    channels: ClassVar = GYRO_CHANNELS
    parameters: ClassVar = tuple(ScenarioParameter(axis, f"{axis}_dps_per_g", 0.0, factor=DPS / G) for axis in "xyz")

    def error(self, inputs: TrueInputs) -> Array:
        return _weighted(self.number, inputs.perfect[:, 3:6])


class GSquared(Additive):
    """e = k f_j²; `{e}_per_g2`, `axis` x, y or z (the channel's own)."""

    parameters: ClassVar = (
        ScenarioParameter("k", "{e}_per_g2", factor=G**-2),
        ScenarioParameter("axis", "axis", "own", choices=("own", "x", "y", "z")),
    )

    def error(self, inputs: TrueInputs) -> Array:
        axis = self.word("axis")
        column = 3 + (self.channel % 3 if axis == "own" else "xyz".index(axis))
        return self.number("k") * inputs.perfect[:, column] ** 2


class Harmonic(Additive):
    """e = a sin(h θ) + b cos(h θ) of a table angle; `sin_{e}`, `cos_{e}` (0 each), `order` h (1), `axis` (inner)."""

    parameters: ClassVar = (
        ScenarioParameter("a", "sin_{e}", 0.0),
        ScenarioParameter("b", "cos_{e}", 0.0),
        positive("order", "order", 1.0),
        ScenarioParameter("axis", "axis", "inner", choices=AXES),
    )

    def error(self, inputs: TrueInputs) -> Array:
        angle = self.number("order") * inputs.angles[:, AXES.index(self.word("axis"))]
        return self.number("a") * np.sin(angle) + self.number("b") * np.cos(angle)


class Tone(Additive):
    """e = k sin(2π f t + φ), a line of vibration; `{e}`, `hz`, `phase_rad` (drawn from the power-on)."""

    parameters: ClassVar = (
        ScenarioParameter("k", "{e}"),
        positive("hz", "hz"),
        ScenarioParameter("phase", "phase_rad", math.inf),
    )

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        drawn, phase = setup.rng.uniform(0.0, 2.0 * math.pi), setup.number("phase")
        self._phase = phase if math.isfinite(phase) else drawn

    def error(self, inputs: TrueInputs) -> Array:
        return self.number("k") * np.sin(2.0 * math.pi * self.number("hz") * inputs.t + self._phase)


class Step(Additive):
    """e = k from t0 on; `{e}`, `at_s`."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}"), ScenarioParameter("at", "at_s", least=0.0))

    def error(self, inputs: TrueInputs) -> Array:
        return np.where(inputs.t >= self.number("at"), self.number("k"), 0.0)


def _weighted(weight: Callable[[str], float], columns: Array) -> Array:
    """Sum over the three axes, in order."""
    return np.asarray(weight("x") * columns[:, 0] + weight("y") * columns[:, 1] + weight("z") * columns[:, 2])
