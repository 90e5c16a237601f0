"""Errors that a sensor adds by itself: functions of temperature, time, what it senses (catalogue 1-11, 13, 14).

x is what the channel itself senses, T the temperature in the case, T0 `REFERENCE_DEGC`, T' its rate, t the time since
power-on.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from filters.channels import DPS, GYROS, G
from filters.effects.hypothesis import ChannelEffect, Parameter
from filters.effects.inputs import BANKS, LAGS, NARROW_PLAYS, REFERENCE_DEGC, SHORT_LAGS, Inputs
from filters.types import Array

WARMUP_TAUS = (40.0, 70.0, 120.0, 200.0, 300.0, 400.0, 600.0, 900.0, 1400.0, 2200.0, 3600.0)


@dataclass(frozen=True)
class ThermalLin(ChannelEffect):
    """e = k (T - T0)."""

    effect: ClassVar = "thermal_lin"
    source: ClassVar = "temperature"
    text: ClassVar = "bias follows temperature"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return (inputs.temperature - REFERENCE_DEGC)[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/K", 1.0, 0.02, 0.3)


@dataclass(frozen=True)
class ThermalPoly(ChannelEffect):
    """e = k1 dT + k2 dT² (+ k3 dT³), dT = T - T0."""

    order: int = 2

    effect: ClassVar = "thermal_poly"
    source: ClassVar = "temperature"
    text: ClassVar = "bias is a curve in temperature"

    @property
    def grid(self) -> int:
        """Number of forms: second and third order."""
        return 2

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return (inputs.temperature - REFERENCE_DEGC)[:, None] ** np.arange(1, self.order + 1)

    def parameters(self) -> tuple[Parameter, ...]:
        priors = ((0.02, 0.3), (1e-3, 0.015), (2e-5, 3e-4))
        names = ("/K", "/K2", "/K3")
        return tuple(self.channel_parameter(f"k{n + 1}", names[n], 1.0, *priors[n])[0] for n in range(self.order))

    def shape(self) -> Mapping[str, float | str]:
        return {"order": float(self.order)}


@dataclass(frozen=True)
class ThermalRate(ChannelEffect):
    """e = k T'."""

    effect: ClassVar = "thermal_rate"
    source: ClassVar = "temperature"
    text: ClassVar = "bias follows the rate of temperature"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.temperature_rate[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/(K/s)", 1.0, 1.0, 15.0)


@dataclass(frozen=True)
class ThermalLag(ChannelEffect):
    """e = k (T_tau - T), T_tau following T as a first-order lag does, from equality at power-on."""

    lag: int = 0

    effect: ClassVar = "thermal_lag"
    source: ClassVar = "temperature"
    text: ClassVar = "bias lags behind temperature"

    @property
    def grid(self) -> int:
        """Number of forms: one for each time constant that is tried."""
        return len(LAGS) if self.is_wide else SHORT_LAGS

    @property
    def is_wide(self) -> bool:
        """Whether it needs a long run, far through temperature."""
        return self.lag >= SHORT_LAGS

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return (inputs.lagged[:, self.lag] - inputs.temperature)[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/K", 1.0, 0.02, 0.3)

    def shape(self) -> Mapping[str, float | str]:
        return {"tau_s": LAGS[self.lag]}


@dataclass(frozen=True)
class Hysteresis(ChannelEffect):
    """e = k · mean of P_n(T - T(0)) / width over a bank of play operators; `start` where in its band each began."""

    bank: int = 0

    effect: ClassVar = "hysteresis"
    source: ClassVar = "temperature"
    text: ClassVar = "bias remembers the way temperature came (play)"

    @property
    def grid(self) -> int:
        """Number of forms: one for each width of the play operators, and where they began, that is tried."""
        return len(BANKS) if self.is_wide else NARROW_PLAYS

    @property
    def is_wide(self) -> bool:
        """Whether it needs a wide range of temperature."""
        return self.bank >= NARROW_PLAYS

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.plays[:, self.bank, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "", 1.0, 0.3, 5.0)

    def shape(self) -> Mapping[str, float | str]:
        width, start = BANKS[self.bank]
        return {"width_k": width} if start == 0.0 else {"width_k": width, "start": start}


@dataclass(frozen=True)
class Warmup(ChannelEffect):
    """e = k exp(-t/tau)."""

    tau: float = WARMUP_TAUS[0]

    effect: ClassVar = "warmup"
    source: ClassVar = "time"
    text: ClassVar = "bias settles after power-on"

    @property
    def grid(self) -> int:
        """Number of forms: one for each time constant."""
        return len(WARMUP_TAUS)

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return np.exp(-inputs.t / self.tau)[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "", 1.0, 0.2, 3.0)

    def shape(self) -> Mapping[str, float | str]:
        return {"tau_s": self.tau}


@dataclass(frozen=True)
class Ramp(ChannelEffect):
    """e = k t."""

    effect: ClassVar = "ramp"
    source: ClassVar = "time"
    text: ClassVar = "bias runs away with time"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.t[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/s", 1.0, 1e-5, 1.5e-4)


@dataclass(frozen=True)
class Bias(ChannelEffect):
    """e = b: found of units turned by hand only; elsewhere the constant bias is what effects are looked for beside."""

    effect: ClassVar = "bias"
    source: ClassVar = "time"
    text: ClassVar = "bias is not zero"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return np.ones((len(inputs.x), 1))

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("b", "", 1.0, 1.0, 12.0)


@dataclass(frozen=True)
class Scale(ChannelEffect):
    """e = k x."""

    effect: ClassVar = "scale"
    source: ClassVar = "motion"
    text: ClassVar = "scale factor is off"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, channel, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", "1", 1.0, 0.01),)


@dataclass(frozen=True)
class Asymmetry(ChannelEffect):
    """e = k abs(x)."""

    effect: ClassVar = "asymmetry"
    source: ClassVar = "motion"
    text: ClassVar = "scale factor differs between + and -"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return np.abs(inputs.x[:, channel, None])

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", "1", 1.0, 3e-3),)


@dataclass(frozen=True)
class NonlinearityCubic(ChannelEffect):
    """e = k x³."""

    effect: ClassVar = "nonlinearity_cubic"
    source: ClassVar = "motion"
    text: ClassVar = "cubic nonlinearity"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, channel, None] ** 3

    def parameters(self) -> tuple[Parameter, ...]:
        """k; priors .3 % of full scale (200 deg/s) and 1 % (4 g)."""
        unit, si = self.input_unit()
        return self.channel_parameter("k", f"/{unit}3", si**3, 7.5e-8, 0.6)


@dataclass(frozen=True)
class NonlinearityQuadratic(ChannelEffect):
    """e = k ω² of a gyro; an accelerometer's own f² is g_squared."""

    effect: ClassVar = "nonlinearity_quadratic"
    where: ClassVar = GYROS
    source: ClassVar = "motion"
    text: ClassVar = "quadratic nonlinearity"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, channel, None] ** 2

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/(deg/s)2", DPS**2, 1.5e-5, 0.0)


@dataclass(frozen=True)
class ThermalScale(ChannelEffect):
    """e = k x (T - T0)."""

    effect: ClassVar = "thermal_scale"
    source: ClassVar = "motion"
    text: ClassVar = "scale factor follows temperature"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return (inputs.x[:, channel] * (inputs.temperature - REFERENCE_DEGC))[:, None]

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", "1/K", 1.0, 2e-4),)


@dataclass(frozen=True)
class CrossAxis(ChannelEffect):
    """e = sum of k_j x_j over the sensors of the same kind on the other axes, or one of them alone."""

    only: int = -1

    effect: ClassVar = "cross_axis"
    source: ClassVar = "motion"
    text: ClassVar = "senses the other axes"

    @property
    def grid(self) -> int:
        """Number of forms: coefficients of both other axes, or of either alone."""
        return 3

    def _others(self) -> list[int]:
        kind = range(3) if self.gyro else range(3, 6)
        return [j for j in kind if j != self.channel and self.only in (-1, j % 3)]

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, self._others()]

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter("xyz"[j % 3], "rad", 1.0, 0.01) for j in self._others())

    def shape(self) -> Mapping[str, float | str]:
        return {"axes": "".join("xyz"[j % 3] for j in self._others())}


@dataclass(frozen=True)
class GSensitivity(ChannelEffect):
    """e = G · f of a gyro, f as the accelerometers read it; all of G, or along one axis alone."""

    only: int = -1

    effect: ClassVar = "g_sensitivity"
    where: ClassVar = GYROS
    source: ClassVar = "motion"
    text: ClassVar = "bias follows specific force"

    @property
    def grid(self) -> int:
        """All, or one of three."""
        return 4

    def _axes(self) -> list[int]:
        return [j for j in range(3) if self.only in (-1, j)]

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, [3 + j for j in self._axes()]]

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter("xyz"[j], "deg/s/g", DPS / G, 0.05) for j in self._axes())

    def shape(self) -> Mapping[str, float | str]:
        return {"axes": "".join("xyz"[j] for j in self._axes())}


@dataclass(frozen=True)
class GSquared(ChannelEffect):
    """e = k f_j²: vibration rectification, or an accelerometer's own quadratic term."""

    axis: int = 0

    effect: ClassVar = "g_squared"
    source: ClassVar = "motion"
    text: ClassVar = "bias follows the square of specific force"

    @property
    def grid(self) -> int:
        """Number of forms: one for each axis of specific force."""
        return 3

    @property
    def label(self) -> str:
        return f"{self.text} along {'xyz'[self.axis]}"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        return inputs.x[:, 3 + self.axis, None] ** 2

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "/g2", G**2, 0.02, 3.0)

    def shape(self) -> Mapping[str, float | str]:
        return {"axis": "xyz"[self.axis]}


def hypotheses(channel: int) -> list[ChannelEffect]:
    """All hypotheses of this module on a channel."""
    plain = (ThermalLin, ThermalRate, Ramp, Scale, Asymmetry, NonlinearityCubic, NonlinearityQuadratic)
    made: list[ChannelEffect] = [kind(channel) for kind in (*plain, ThermalScale) if channel in kind.where]
    made += [CrossAxis(channel, only) for only in (-1, 0, 1, 2) if only != channel % 3]
    made += [GSensitivity(channel, only) for only in (-1, 0, 1, 2) if channel in GSensitivity.where]
    made += [ThermalPoly(channel, order) for order in (2, 3)]
    made += [ThermalLag(channel, number) for number in range(len(LAGS))]
    made += [Hysteresis(channel, number) for number in range(len(BANKS))]
    made += [Warmup(channel, tau) for tau in WARMUP_TAUS]
    made += [GSquared(channel, axis) for axis in range(3)]
    return made
