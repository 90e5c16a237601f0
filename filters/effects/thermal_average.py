"""A curve in temperature, lags and plays at once: the average of several thermal forms, as one effect.

Thermal forms are linear in the same columns, which are fitted together and averaged over how large memory may be
(`filters.tracing.thermal_forms`). With u = (T - middle) / half of the range of temperature that was seen in training, a
curve is

    c1 u + c2 p2(u) + c3 p3(u) + Σ l_τ (T_τ - T) / half + Σ h_w (P_w - (T - T(0))) / half

where p2 and p3 are u² and u³ within the range and go on straight beyond it, with the slope at its end, and P_w is the
mean of a bank of play operators. The effect is e = a · mean curve + Σ b_i · spread_i: one state for the mean, and one
for each of the directions in which the way back is known least, each as large as its standard deviation. A constant
is the bias.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from filters.channels import error_unit
from filters.effects.hypothesis import Hypothesis, Parameter
from filters.effects.inputs import BANKS, LAGS, Inputs
from filters.effects.records import ShapeValue, number_of, numbers_of
from filters.errors import InputError
from filters.types import Array

FORM = "average"  # what `form` is among an effect's parameters in a file where it is an average
ORDERS = 3
_MOST_SPREADS = 9
_Key = TypeVar("_Key")
_LEADING = ("thermal_lin", "thermal_poly", "thermal_lag", "hysteresis")


def columns(T: Array, lagged: Array, plays: Array, low: float, high: float) -> list[Array]:
    """All columns that forms are made of: curve, lags, plays; each of shape (n,), without unit.

    `T`, `lagged`, `plays`: as in `Inputs`, shapes (n,), (n, LAGS), (n, BANKS).
    `low`, `high`: range of temperature in training, degC.
    """
    half = 0.5 * (high - low)
    u = (T - 0.5 * (low + high)) / half
    inner = np.clip(u, -1.0, 1.0)
    over = u - inner
    made = [u, inner * inner + 2.0 * over * inner, inner * inner * inner + 3.0 * over]
    made += [(lagged[:, k] - T) / half for k in range(len(LAGS))]
    return made + [(plays[:, k] * width - T) / half for k, (width, _) in enumerate(BANKS)]


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalAverage(Hypothesis):
    """The average of thermal forms on a channel, named after the form with the most evidence."""

    # low, high: range of temperature in training, degC
    low: float
    high: float
    # what each of `columns` is multiplied with, in the channel's unit of error: of the mean, then of each spread
    curves: tuple[tuple[float, ...], ...]

    @classmethod
    def of(
        cls, channel: int, leading: str, low: float, high: float, curves: tuple[tuple[float, ...], ...]
    ) -> "ThermalAverage":
        """An average of amplitude 1, and spreads of their own standard deviations."""
        names = ("amplitude", *(f"spread{n}" for n in range(1, len(curves))))

        def added_up(inputs: Inputs, channel: int) -> Array:
            """One column a curve; in order, so that it does not depend on how many samples come at once."""
            out = np.zeros((inputs.temperature.size, len(curves)))
            for k, column in enumerate(columns(inputs.temperature, inputs.lagged, inputs.plays, low, high)):
                for n, curve in enumerate(curves):
                    if curve[k] != 0.0:
                        out[:, n] += curve[k] * column
            return out * error_unit(channel)[1]

        return cls(
            effect=leading,
            channels=(channel,),
            source="temperature",
            parameters=tuple(Parameter(name, "1", 1.0, 1.0) for name in names),
            columns=added_up,
            shape={"form": FORM},
            words="temperature, an average of forms",
            low=low,
            high=high,
            curves=curves,
        )

    def coefficients(self) -> dict[str, ShapeValue]:
        """What an effects file keeps of it beside `shape`."""
        used = [any(curve[k] for curve in self.curves) for k in range(ORDERS + len(LAGS) + len(BANKS))]
        lags = [k for k in range(len(LAGS)) if used[ORDERS + k]]
        banks = [k for k in range(len(BANKS)) if used[ORDERS + len(LAGS) + k]]
        out: dict[str, ShapeValue] = {
            "low_degc": self.low,
            "high_degc": self.high,
            "tau_s": [LAGS[k] for k in lags],
            "width_k": [BANKS[k][0] for k in banks],
            "start": [BANKS[k][1] for k in banks],
            "spreads": float(len(self.curves) - 1),
        }
        for n, curve in enumerate(self.curves):
            own = f"_{n}" if n else ""
            out[f"curve{own}"] = list(curve[:ORDERS])
            out[f"lag{own}"] = [curve[ORDERS + k] for k in lags]
            out[f"play{own}"] = [curve[ORDERS + len(LAGS) + k] for k in banks]
        return out


def from_file(effect: str, channel: int, shape: Mapping[str, ShapeValue]) -> ThermalAverage:
    """An average as `coefficients` wrote it.

    Raises InputError if something is missing, or is none of the time constants, widths and starts that there are.
    """
    if effect not in _LEADING:
        raise InputError(f'"{effect}" can\'t be an average; these can: {", ".join(_LEADING)}')
    low, high = number_of(shape, "low_degc"), number_of(shape, "high_degc")
    if not high > low:
        raise InputError(f"`high_degc` of {effect} is {high}, not above `low_degc`, {low}")
    spreads = number_of(shape, "spreads", 0.0)
    if not (spreads.is_integer() and 0 <= spreads <= _MOST_SPREADS):
        raise InputError(f"`spreads` of {effect} is {spreads:g}, not a number from 0 to {_MOST_SPREADS}")
    curves = tuple(_curve(effect, shape, f"_{n}" if n else "") for n in range(int(spreads) + 1))
    return ThermalAverage.of(channel, effect, low, high, curves)


def _curve(effect: str, shape: Mapping[str, ShapeValue], own: str) -> tuple[float, ...]:
    curve = numbers_of(shape, f"curve{own}")
    if len(curve) != ORDERS:
        raise InputError(f"`curve{own}` of {effect} has {len(curve)} numbers, not {ORDERS}")
    lags = _placed(effect, "tau_s", numbers_of(shape, "tau_s"), numbers_of(shape, f"lag{own}"), list(LAGS))
    widths, starts = numbers_of(shape, "width_k"), numbers_of(shape, "start")
    if len(widths) != len(starts):
        raise InputError(f"`start` of {effect} has {len(starts)} entries for {len(widths)} of `width_k`")
    banks = list(zip(widths, starts, strict=True))
    plays = _placed(effect, "width_k", banks, numbers_of(shape, f"play{own}"), list(BANKS))
    return (*curve, *lags, *plays)


def _placed(effect: str, name: str, keys: list[_Key], values: list[float], known: list[_Key]) -> list[float]:
    """Values at the places of their keys among those that are known, 0 elsewhere."""
    if len(keys) != len(values):
        raise InputError(f"`{name}` of {effect} has {len(keys)} entries for {len(values)} numbers")
    out = [0.0] * len(known)
    for key, value in zip(keys, values, strict=True):
        if key not in known:
            raise InputError(f"`{name}` of {effect} has {key}, not one of {known}")
        out[known.index(key)] = value
    return out
