"""Numbers as people read them, and whose readings they are."""

import math

NOTHING = "–"  # in the place of a number that is not known
ORIGIN = {"measured": "measured", "simulated": "SIMULATED", "unknown": "origin not stated"}
"""Who made the readings, beside a result's name: what is simulated stands out."""


def readings(kind: str) -> str:
    """The same within a sentence."""
    return "origin of readings not stated" if kind not in ORIGIN or kind == "unknown" else f"{ORIGIN[kind]} readings"


def plus_minus(value: float, sd: float | None, unit: str) -> str:
    """Value and standard deviation to the same digit, two of them of the deviation: "0.0200 ± 0.0010 deg/s/K"."""
    tail = f" {unit}" if unit else ""
    if sd is None or not math.isfinite(sd) or sd <= 0.0:
        return f"{value:.4g}{tail}"
    if max(abs(value), sd) < 1e-3 or sd >= 1e5:
        power = math.floor(math.log10(max(abs(value), sd)))
        scale = 10.0**power
        decimals = _decimals(sd / scale)
        return f"({value / scale:.{decimals}f} ± {sd / scale:.{decimals}f})e{power:d}{tail}"
    decimals = _decimals(sd)
    value = round(value, decimals) + 0.0  # without a negative zero
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}{tail}"


def _decimals(sd: float) -> int:
    return max(0, 1 - math.floor(math.log10(sd)))


TOO_SHORT = "too short to tell (10 s at least; a minute tells it to 16 %)"
"""Of the noise of a log, from white noise's differences of means over 1 s."""
_TELLS_NOISE = 0.405


def noise_certainty(relative_sd: float | None) -> str | None:
    """How sure the measured noise of a log is: "± 16 % (1 sd)"; None where the log is too short."""
    if relative_sd is None or relative_sd > _TELLS_NOISE:
        return None
    return f"± {100.0 * relative_sd:.0f} % (1 sd)"


def times_floor(x: float | None) -> str:
    """A ratio to the floor: two digits below ten."""
    if x is None:
        return NOTHING
    return f"{x:.0f}" if x >= 99.5 else f"{x:.1f}" if x >= 9.95 else f"{x:.2f}"


def share(x: float) -> str:
    """A share as a percentage that never claims more than it is."""
    percent = 100.0 * x
    if percent < 1.0:
        return "less than 1 %"
    return f"{percent:.0f} %" if percent < 99.5 else f"{min(99.9, math.floor(percent * 10.0) / 10.0):.1f} %"


def odds(x: float) -> str:
    """Odds for, or against, in whole numbers."""
    if x >= 1000.0:
        return "odds over 1000:1"
    return f"odds {x:.0f}:1" if x >= 1.0 else f"odds 1:{1.0 / max(x, 1e-3):.0f}"


def duration(seconds: float) -> str:
    """Seconds, or minutes, or hours."""
    if seconds < 600.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def three_digits(x: float | None) -> str:
    """Three digits, so that numbers of one column compare: 0.120, 12.0, 120; a dash for none."""
    if x is None:
        return NOTHING
    return f"{x:#.3g}".removesuffix(".") if abs(x) < 999.5 else f"{x:.4g}"
