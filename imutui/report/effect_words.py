"""Names that files and results have for effects, as plain words for whoever reads a screen or a page."""

import math
from collections.abc import Iterable

from filters.effects import plain_names
from imutui.estimates import EffectField


def state(name: str) -> str:
    """A state in the filter: "gy thermal_lin k (rad/s/K)" is "gy: bias follows temperature"."""
    return plain_names.state(name)


def estimate(effect: EffectField) -> str:
    """Return what a state of the filter is, its value ± 3 sd, and its unit; with as many decimals as are certain."""
    value, sd, unit = effect["value"], effect["sd"], effect["name"].removesuffix(")").partition(" (")[2]
    if not sd:
        return f"{state(effect['name'])} {value:.4g} {unit}".rstrip()
    decimals = min(max(1 - math.floor(math.log10(3.0 * sd)), 0), 9)
    return f"{state(effect['name'])} {value:z.{decimals}f} ±{3.0 * sd:.{decimals}f} {unit}".rstrip()


def included(names: Iterable[str]) -> str:
    """Effects with their channels in brackets, "thermal_lin (gx gy)", as one sentence's part."""
    parts = ((name, *name.removesuffix(")").partition(" (")) for name in names)
    return "; ".join(
        plain_names.on_channels(code, channels.split()) if bracket else name for name, code, bracket, channels in parts
    )
