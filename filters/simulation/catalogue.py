"""The effects by name, and what a scenario asks of one."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from filters.channels import CHANNELS
from filters.errors import InputError
from filters.first_order import first_order
from filters.simulation import additive, output, truth
from filters.simulation.parameters import EffectKind, ScenarioParameter, Setup, TrueInputs, positive
from filters.types import Array

# -------------------------------------------------------------------------------------------------------------- drift
# Errors that nothing logged drives: two-level noise, random walk, Gauss-Markov drift. Drawn anew at each power-on.


class Telegraph(additive.Additive):
    """e = k s(t), s in {0, 1}, each level held for an exponential time; `{e}`, `mean_s` (mean of those times)."""

    parameters: ClassVar = (ScenarioParameter("k", "{e}"), positive("mean", "mean_s"))

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._level = int(self.rng.integers(2))
        self._until = self.rng.exponential(self.number("mean"))

    def error(self, inputs: TrueInputs) -> Array:
        out = np.empty(inputs.t.size)
        done = 0
        while done < out.size:
            end = int(np.searchsorted(inputs.t, self._until))
            out[done:end] = self._level
            if end < out.size:
                self._level = 1 - self._level
                self._until += self.rng.exponential(self.number("mean"))
            done = end
        return self.number("k") * out


class RandomWalk(additive.Additive):
    """e(k+1) = e(k) + q √T n(k), n white of unit variance, T the sampling period, from 0; `{e}_per_sqrt_s` is q."""

    parameters: ClassVar = (ScenarioParameter("q", "{e}_per_sqrt_s", least=0.0),)

    _at = 0.0

    def error(self, inputs: TrueInputs) -> Array:
        sd = self.number("q") / math.sqrt(self.rate_hz)
        walk = self._at + np.cumsum(sd * self.rng.standard_normal(inputs.t.size))
        self._at = float(walk[-1])
        return walk


class GaussMarkov(additive.Additive):
    """e(k+1) = p e(k) + σ √(1 - p²) n(k), p = exp(-T/τ), stationary from the start; `{e}` is σ, `tau_s`."""

    parameters: ClassVar = (ScenarioParameter("sd", "{e}", least=0.0), positive("tau", "tau_s"))

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._pole = math.exp(-1.0 / (setup.rate_hz * setup.number("tau")))
        self._sd = setup.number("sd") * math.sqrt(-math.expm1(-2.0 / (setup.rate_hz * setup.number("tau"))))
        self._memory = self._pole * setup.number("sd") * float(self.rng.standard_normal())

    def error(self, inputs: TrueInputs) -> Array:
        drive = self._sd * self.rng.standard_normal(inputs.t.size)
        out, self._memory = first_order(drive, 1.0, self._pole, self._memory)
        return out


# ---------------------------------------------------------------------------------------------------------- catalogue

EFFECTS: dict[str, type[EffectKind]] = {
    "thermal_lin": additive.ThermalLin,
    "thermal_poly": additive.ThermalPoly,
    "thermal_rate": additive.ThermalRate,
    "thermal_lag": additive.ThermalLag,
    "hysteresis": additive.Hysteresis,
    "warmup": additive.Warmup,
    "ramp": additive.Ramp,
    "scale": additive.Scale,
    "asymmetry": additive.Asymmetry,
    "nonlinearity_cubic": additive.NonlinearityCubic,
    "nonlinearity_quadratic": additive.NonlinearityQuadratic,
    "thermal_scale": additive.ThermalScale,
    "cross_axis": additive.CrossAxis,
    "mounting": truth.Mounting,
    "g_sensitivity": additive.GSensitivity,
    "g_squared": additive.GSquared,
    "earth_rate": truth.EarthRate,
    "harmonic": additive.Harmonic,
    "delay": truth.Delay,
    "lever_arm": truth.LeverArm,
    "tilt": truth.Tilt,
    "gravity": truth.Gravity,
    "tone": additive.Tone,
    "step": additive.Step,
    "telegraph": Telegraph,
    "random_walk": RandomWalk,
    "gauss_markov": GaussMarkov,
    "noise_level": output.NoiseLevel,
    "bandwidth": output.Bandwidth,
    "noise_crosstalk": output.NoiseCrosstalk,
    "spikes": output.Spikes,
    "stuck": output.Stuck,
    "saturation": output.Saturation,
    "coarse": output.Coarse,
    "dropout": output.Dropout,
    "jitter": output.Jitter,
}


@dataclass(frozen=True)
class Effect:
    """What a scenario asks of one effect.

    Raises InputError if a name, a channel, a parameter or a value does not fit; the message says what would.
    """

    name: str  # in `EFFECTS`
    channels: tuple[str, ...] = ()  # of gx, gy, gz, ax, ay, az; empty for an effect that is everywhere by itself
    # as its class names them, in the units of the names
    parameters: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.name not in EFFECTS:
            raise InputError(f'`name` is "{self.name}", no effect; known: {", ".join(EFFECTS)}')
        kind = EFFECTS[self.name]
        if not self.channels and not kind.everywhere:
            raise InputError(f"`channel` is missing for {self.name}: one or several of {', '.join(kind.channels)}")
        for channel in self.channels:
            if channel not in kind.channels:
                raise InputError(f'`channel` is "{channel}"; {self.name} can be on {", ".join(kind.channels)}')
        if len(set(self.channels)) < len(self.channels):
            raise InputError(f"`channel` is {list(self.channels)}: one is named twice")
        whole = kind.everywhere and not kind.selectable
        if whole and self.channels and set(self.channels) != set(kind.channels):
            raise InputError(f"`channel` is {list(self.channels)}; {self.name} is on all it concerns: leave it out")
        self.made(1.0, lambda _: np.random.default_rng(0))

    def made(self, rate_hz: float, rng: Callable[[int], np.random.Generator]) -> list[tuple[int, EffectKind]]:
        """The effect at work: an object for each channel, or one for all of them, under the first one's number.

        `rate_hz`: of the readings.
        `rng`: gives the generator of a channel's number.
        Returns number of the channel, and the object, in the order of the channels.
        """
        kind = EFFECTS[self.name]
        numbers = tuple(CHANNELS.index(channel) for channel in self.channels or kind.channels)
        one = kind.everywhere or kind.together
        return [
            (n, kind(Setup(n, numbers, self._values(kind, n), rate_hz, rng(n))))
            for n in (numbers[:1] if one else numbers)
        ]

    def _values(self, kind: type[EffectKind], channel: int) -> dict[str, float | str]:
        names = {parameter.name_on(channel): parameter for parameter in kind.parameters}
        for name in self.parameters:
            if name not in names:
                where = f"{self.name} on {CHANNELS[channel]}"
                raise InputError(f"`{name}` is no parameter of {where}; it has: {', '.join(names)}")
        return {p.key: self._value(name, p, channel) for name, p in names.items()}

    def _value(self, name: str, parameter: ScenarioParameter, channel: int) -> float | str:
        value = self.parameters.get(name, parameter.default)
        if value is None:
            raise InputError(f"`{name}` is missing for {self.name} on {CHANNELS[channel]}")
        if parameter.choices:
            if value not in parameter.choices:
                raise InputError(f'`{name}` is "{value}", not one of: {", ".join(parameter.choices)}')
            return value
        given = name in self.parameters
        if not isinstance(value, int | float) or isinstance(value, bool) or (given and not np.isfinite(value)):
            raise InputError(f"`{name}` is {value!r}, not a finite number")
        if not parameter.least <= value <= parameter.most or (parameter.above and value == parameter.least):
            bounds = f"{'more than' if parameter.above else 'at least'} {parameter.least:g}"
            bounds += f" and at most {parameter.most:g}" if np.isfinite(parameter.most) else ""
            raise InputError(f"`{name}` is {value:g}; it is {bounds}")
        return parameter.si(float(value), channel)
