"""A correction of readings as arithmetic: what three lines of a program can do, and what they leave out.

    corrected = reading - bias - A reading - Σ_n K_n (T - T0)^n

gx, gy, gz in deg/s, ax, ay, az in g, in the unit's own axes and sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.effects.inputs import REFERENCE_DEGC
from filters.types import Array
from imutui.jobs.correction_terms import Term

_MG = 1e-3
_POWERS = {"k": 1, "k1": 1, "k2": 2, "k3": 3}
_ORDERS = 3
_AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Correction:
    """A correction of the six readings.

    Attributes
    ----------
    bias : Array
        deg/s and g, shape (6,); zero where none is known.
    by_reading : Array
        A, per deg/s or g read on each channel, shape (6, 6).
    by_temperature : Array
        K_1 to K_3, per K, K² and K³ from `REFERENCE_DEGC` on, shape (3, 6).
    left_out : tuple of str
        Effects that take more than a reading and its temperature, in words.
    """

    bias: Array
    by_reading: Array
    by_temperature: Array
    left_out: tuple[str, ...]

    @property
    def orders(self) -> int:
        """Powers of temperature in it."""
        used = np.flatnonzero(self.by_temperature.any(axis=1))
        return int(used[-1]) + 1 if used.size else 0


def correction(bias: Sequence[float | None], terms: Sequence[Term]) -> Correction:
    """Correction of constant biases and of effects.

    Parameters
    ----------
    bias : sequence of float or None
        Gyros in deg/s, accelerometers in mg; None counts as zero.
    terms : sequence of Term
        States of effects.
    """
    made = np.array([0.0 if b is None else b for b in bias], float)
    made[3:] *= _MG
    A, K = np.zeros((6, 6)), np.zeros((_ORDERS, 6))
    left_out: dict[str, None] = {}
    for term in terms:
        for name in term.channels or ("",):
            if not _take(term, name, made, A, K):
                left_out[_words(term)] = None
    return Correction(made, A, K, tuple(left_out))


def _take(term: Term, channel: str, bias: Array, A: Array, K: Array) -> bool:
    """Add a term on a channel; False if it is none of these."""
    if channel not in CHANNELS:
        return False
    c = CHANNELS.index(channel)
    value = term.value * (_MG if term.unit.startswith("mg") else 1.0)
    match term.effect:
        case "bias":
            bias[c] += value
        case "thermal_lin" | "thermal_poly" if term.state in _POWERS:
            K[_POWERS[term.state] - 1, c] += value
        case "scale":
            A[c, c] += value
        case "cross_axis" if term.state in _AXES:
            A[c, c // 3 * 3 + _AXES.index(term.state)] += value
        case "g_sensitivity" if term.state in _AXES:
            A[c, 3 + _AXES.index(term.state)] += value
        case _:
            return False
    return True


def _words(term: Term) -> str:
    return plain_names.on_channels(term.effect, term.channels) if term.channels else term.effect


def python(c: Correction) -> str:
    """Three lines of Python: `reading` and `temperature` in, `corrected` out."""
    names, values, steps = ["bias"], [_array(c.bias)], ["reading - bias"]
    if c.by_reading.any():
        names.append("A")
        values.append("np.array([" + ", ".join(_list(row) for row in c.by_reading) + "])")
        steps.append("A @ reading")
    for n in range(c.orders):
        names.append(f"K{n + 1}")
        values.append(_array(c.by_temperature[n]))
        steps.append(f"K{n + 1} * (temperature - {REFERENCE_DEGC})" + (f"**{n + 1}" if n else ""))
    constants = f"{', '.join(names)} = {', '.join(values)}"
    return "\n".join(["import numpy as np", constants, f"corrected = {' - '.join(steps)}"])


def c_lines(c: Correction) -> str:
    """Three lines of C: `reading` (6) and `temperature` in, `corrected` (6) out."""
    constants = [f"bias[6] = {_braces(c.bias)}"]
    steps = ["reading[i] - bias[i]"]
    if c.by_reading.any():
        constants.append("A[6][6] = {" + ", ".join(_braces(row) for row in c.by_reading) + "}")
        steps += [f"A[i][{j}] * reading[{j}]" for j in range(6) if c.by_reading[:, j].any()]
    for n in range(c.orders):
        constants.append(f"K{n + 1}[6] = {_braces(c.by_temperature[n])}")
        steps.append(" * ".join([f"K{n + 1}[i]", *["dT"] * (n + 1)]))
    first = f"static const double {', '.join(constants)};"
    second = f"double corrected[6], dT = temperature - {REFERENCE_DEGC};" if c.orders else "double corrected[6];"
    return "\n".join([first, second, f"for (int i = 0; i < 6; i++) corrected[i] = {' - '.join(steps)};"])


def _array(values: Array) -> str:
    return f"np.array({_list(values)})"


def _list(values: Array) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _braces(values: Array) -> str:
    return "{" + ", ".join(map(_number, values)) + "}"


def _number(value: float) -> str:
    """As many digits as a reading can ever use; a point or an exponent, so that C takes it for a double."""
    text = f"{value:.9g}"
    return text if any(sign in text for sign in ".e") else text + ".0"
