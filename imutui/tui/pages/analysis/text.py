"""What the analysis page says of a channel: what it is made of, what the cursor reads, how to read it. No textual."""

import math

import numpy as np

from imutui.session.snapshot import AllanSnapshot, HistogramSnapshot, SpectrumSnapshot, StatisticsSnapshot
from imutui.tui import formatting
from imutui.tui.pages.analysis import figures

TITLES = ("Allan deviation", "spectrum", "histogram")
_MEANINGS = (
    "Dotted: {}'s white noise. Slope -1/2 white, 0 instability, +1/2 walk",
    "Dotted: {}'s white noise up to its bandwidth. Spikes stand out of noise",
    "Line: the Gaussian of the same mean and sd. Bins are whole counts wide",
)
_WITHOUT_DATA_SHEET = (
    "Slope -1/2 is white noise, 0 instability, +1/2 a random walk",
    "Spikes stand out of noise",
    _MEANINGS[2],
)


def made_of(seen: StatisticsSnapshot) -> str:
    """How many packets, over how long, and what gaps."""
    packets = formatting.plural(seen["packets"], "packet")
    parts = [f"{packets} in {formatting.minutes(seen['seconds'])}"]
    if seen["period_s"]:
        parts.append(f"{1.0 / seen['period_s']:.2f} Hz")
    if seen["stretches"] > 1:
        parts.append(f"{formatting.plural(seen['stretches'] - 1, 'gap')} left out")
    return ", ".join(parts)


def meaning(view: int, seen: StatisticsSnapshot) -> str:
    """How to read the figure."""
    return (_WITHOUT_DATA_SHEET if seen["white"] is None else _MEANINGS)[view].format(_data_sheet(seen))


def _data_sheet(seen: StatisticsSnapshot) -> str:
    """Whose white noise is drawn, in a word or two."""
    return seen["white_of"].removesuffix(" data sheet")


def nothing(view: int, seen: StatisticsSnapshot) -> str:
    """Why there is no figure."""
    has = (seen["allan"], seen["spectrum"], seen["histogram"])[view]
    if has is not None:
        return "all packets read the same: there is no noise to show"
    needed = (8, 64, 1)[view]
    return f"takes {needed} packets without a gap; there are {seen['packets']}"


def reading(view: int, seen: StatisticsSnapshot, stop: int) -> tuple[str, str]:
    """What the cursor reads, and what that is to be compared with."""
    allan, spectrum, histogram = seen["allan"], seen["spectrum"], seen["histogram"]
    if view == figures.ALLAN and allan is not None:
        return _allan(allan, seen, stop)
    if view == figures.SPECTRUM and spectrum is not None:
        return _spectrum(spectrum, seen, stop)
    if view == figures.HISTOGRAM and histogram is not None:
        return _histogram(histogram, formatting.unit_name(seen["unit"]), stop)
    return "", ""


def _allan(allan: AllanSnapshot, seen: StatisticsSnapshot, stop: int) -> tuple[str, str]:
    tau, deviation, dof = allan["tau"][stop], allan["deviation"][stop], allan["dof"][stop]
    value = _with_sd(deviation, deviation / math.sqrt(2.0 * dof))
    said = f"averaged over {tau:.4g} s: deviation {value} {formatting.unit_name(seen['unit'])}"
    if seen["white"] is None:
        return said, ""
    line = seen["white"] / math.sqrt(tau)
    return said, f"{_data_sheet(seen)}'s white noise there: {line:.4g}; this is {deviation / line:.3g} of it"


def _spectrum(spectrum: SpectrumSnapshot, seen: StatisticsSnapshot, stop: int) -> tuple[str, str]:
    density, averages = spectrum["density"][stop], spectrum["averages"][stop]
    value = _with_sd(density, 0.5 * density / math.sqrt(averages))
    said = f"at {spectrum['hz'][stop]:.4g} Hz: density {value} {formatting.unit_name(seen['unit'])}/√Hz"
    parts = []
    if seen["white"] is not None:
        level = math.sqrt(2.0) * seen["white"]
        parts.append(f"{density / level:.3g} of {_data_sheet(seen)}'s {level:.4g}")
    if figures.stands_out(spectrum)[stop]:
        parts.append(f"a line: {spectrum['peak'][stop]:.4g} at {spectrum['peak_hz'][stop]:.5g} Hz")
    length = 1.0 / spectrum["resolution_hz"]
    parts.append(f"{formatting.plural(spectrum['segments'], 'segment')} of {length:.3g} s")
    return said, "; ".join(parts)


def _histogram(histogram: HistogramSnapshot, unit: str, stop: int) -> tuple[str, str]:
    width, sd = histogram["width"], histogram["sd"]
    low = histogram["edge"] + stop * width
    decimals = _decimals(width) + 1
    should = float(figures.expected(histogram)[stop])
    bins = f"{low:.{decimals}f} to {low + width:.{decimals}f} {unit}"
    packets = formatting.plural(histogram["counts"][stop], "packet")
    said = f"{bins}: {packets}, Gaussian {should:.1f} ± {math.sqrt(should):.1f}"
    parts = [
        f"mean {histogram['mean']:.{decimals}f}, sd {sd:.{_decimals(sd) + 3}f} {unit}",
        f"bins of {formatting.plural(histogram['width_counts'], 'count')}",
    ]
    outside = histogram["below"] + histogram["above"]
    if outside:
        parts.append(f"{formatting.plural(outside, 'packet')} outside")
    return said, "; ".join(parts)


def _with_sd(value: float, sd: float) -> str:
    """Value and standard deviation with as many decimals as the latter deserves."""
    decimals = _decimals(sd) + 1
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}"


def _decimals(value: float) -> int:
    return int(np.clip(-math.floor(math.log10(value)), 0, 9)) if value > 0.0 else 0
