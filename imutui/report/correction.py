"""A correction of readings as arithmetic: what three lines of a program can do."""

from filters.effects.inputs import REFERENCE_DEGC
from filters.types import Array
from imutui.jobs.linear_correction import LinearCorrection


def formula(c: LinearCorrection) -> str:
    """As people write it."""
    terms = ["reading − bias"]
    terms += ["A · reading"] if c.of_reading and c.by_reading.any() else []
    terms += [f"K{n} · (T − {REFERENCE_DEGC:g} °C){'²³'[n - 2] if n > 1 else ''}" for n in range(1, c.orders + 1)]
    inner = " − ".join(terms)
    return f"corrected = M · ({inner})" if _is_product(c) else f"corrected = {inner}"


def python(c: LinearCorrection) -> str:
    """Three lines of Python: `reading` and `temperature` in, `corrected` out."""
    names, values, steps = ["bias"], [_array(c.bias)], ["reading - bias"]
    if c.by_reading.any():
        names.append("A" if c.of_reading else "M")
        values.append(_rows(c.by_reading if c.of_reading else c.matrix))
    if c.of_reading and c.by_reading.any():
        steps.append("A @ reading")
    for n in range(c.orders):
        names.append(f"K{n + 1}")
        values.append(_array(c.by_temperature[n]))
        steps.append(f"K{n + 1} * (temperature - {REFERENCE_DEGC})" + (f"**{n + 1}" if n else ""))
    constants = f"{', '.join(names)} = {', '.join(values)}"
    inner = " - ".join(steps)
    return "\n".join(["import numpy as np", constants, f"corrected = {f'M @ ({inner})' if _is_product(c) else inner}"])


def c_lines(c: LinearCorrection) -> str:
    """Three lines of C: `reading` (6) and `temperature` in, `corrected` (6) out."""
    j = "j" if _is_product(c) else "i"
    constants = [f"bias[6] = {_braces(c.bias)}"]
    steps = [f"reading[{j}] - bias[{j}]"]
    if c.by_reading.any():
        rows = ", ".join(_braces(row) for row in (c.by_reading if c.of_reading else c.matrix))
        constants.append(f"{'A' if c.of_reading else 'M'}[6][6] = {{{rows}}}")
    if c.of_reading:
        steps += [f"A[i][{k}] * reading[{k}]" for k in range(6) if c.by_reading[:, k].any()]
    for n in range(c.orders):
        constants.append(f"K{n + 1}[6] = {_braces(c.by_temperature[n])}")
        steps.append(" * ".join([f"K{n + 1}[{j}]", *["dT"] * (n + 1)]))
    first = f"static const double {', '.join(constants)};"
    second = f"double corrected[6]{' = {0}' if _is_product(c) else ''}"
    second += f", dT = temperature - {REFERENCE_DEGC};" if c.orders else ";"
    third = "for (int i = 0; i < 6; i++) "
    if _is_product(c):
        third += f"for (int j = 0; j < 6; j++) corrected[i] += M[i][j] * ({' - '.join(steps)});"
    else:
        third += f"corrected[i] = {' - '.join(steps)};"
    return "\n".join([first, second, third])


def _is_product(c: LinearCorrection) -> bool:
    return bool(c.by_reading.any()) and not c.of_reading


def _rows(matrix: Array) -> str:
    return "np.array([" + ", ".join(_list(row) for row in matrix) + "])"


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
