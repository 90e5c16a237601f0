"""Statistics of a channel as figures, and where a cursor that reads them can stand. Pure functions, no textual."""

import math

import numpy as np

from imutui.session.snapshot import AllanSnapshot, HistogramSnapshot, SpectrumSnapshot, StatisticsSnapshot
from imutui.tui.widgets import axes
from imutui.tui.widgets.axes import Axis, Curve, Figure
from imutui.tui.widgets.raster import Floats

ALLAN, SPECTRUM, HISTOGRAM = range(3)
_LEAST_BAR = 0.1
_HEADROOM = 1.1
_OUTLIER, _LEAST_LINE = 5.0, 3.0
_NEIGHBOURS = 10


def of(view: int, seen: StatisticsSnapshot) -> Figure | None:
    """Figure of a view without a cursor; None as long as there are too few packets, or nothing moves."""
    match view:
        case 0:
            return None if seen["allan"] is None else _allan(seen["allan"], seen)
        case 1:
            return None if seen["spectrum"] is None else _spectrum(seen["spectrum"], seen)
        case _:
            return None if seen["histogram"] is None else _histogram(seen["histogram"], seen["unit"])


def stops(view: int, seen: StatisticsSnapshot) -> Floats:
    """Where the cursor can stand: averaging times, middles of bands, middles of bins."""
    allan, spectrum, histogram = seen["allan"], seen["spectrum"], seen["histogram"]
    if view == ALLAN and allan is not None:
        return np.array(allan["tau"])
    if view == SPECTRUM and spectrum is not None:
        return np.array(spectrum["hz"])
    if view == HISTOGRAM and histogram is not None:
        return histogram["edge"] + (np.arange(len(histogram["counts"])) + 0.5) * histogram["width"]
    return np.zeros(0)


def first_stop(view: int, seen: StatisticsSnapshot) -> float:
    """Where the cursor begins: at 1 s, at the line that stands out most, at the mean; `stops` must not be empty."""
    spectrum, histogram = seen["spectrum"], seen["histogram"]
    if view == SPECTRUM and spectrum is not None:
        return spectrum["hz"][int(np.argmax(_over_neighbours(spectrum)))]
    if view == HISTOGRAM and histogram is not None:
        return histogram["mean"]
    return 1.0


def nearest(view: int, seen: StatisticsSnapshot, x: float) -> int:
    """Number of the stop that is nearest to an x."""
    places = stops(view, seen)
    distance = np.abs(places - x) if view == HISTOGRAM else np.abs(np.log(places / max(x, 1e-300)))
    return int(np.argmin(distance))


def expected(histogram: HistogramSnapshot) -> Floats:
    """Packets that each bin would have of a Gaussian with the same mean and sd."""
    count = sum(histogram["counts"]) + histogram["below"] + histogram["above"]
    sd = max(histogram["sd"], 1e-300) * math.sqrt(2.0)
    edges = histogram["edge"] + np.arange(len(histogram["counts"]) + 1) * histogram["width"]
    below = np.array([0.5 * math.erfc((histogram["mean"] - edge) / sd) for edge in edges])
    return np.asarray(count * np.diff(below))


def stands_out(spectrum: SpectrumSnapshot) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """In which bands the peak is more than noise makes of as many segments, slopes included."""
    few = 1.0 / max(spectrum["segments"], 1)
    noise = max(1.0 + _OUTLIER * math.sqrt(few) + 6.0 * few, _LEAST_LINE)
    return np.asarray(_over_neighbours(spectrum) ** 2 > noise)


def _over_neighbours(spectrum: SpectrumSnapshot) -> Floats:
    """Peaks over the median density of the bands around."""
    around = np.pad(np.maximum(spectrum["density"], 1e-300), _NEIGHBOURS, mode="edge")
    level = np.median(np.lib.stride_tricks.sliding_window_view(around, 2 * _NEIGHBOURS + 1), axis=1)
    return np.asarray(np.array(spectrum["peak"]) / level, float)


def _allan(allan: AllanSnapshot, seen: StatisticsSnapshot) -> Figure | None:
    tau, deviation = np.array(allan["tau"]), np.array(allan["deviation"])
    moves = deviation > 0.0
    if not moves.any():
        return None
    tau, deviation = tau[moves], deviation[moves]
    relative = 1.0 / np.sqrt(2.0 * np.array(allan["dof"])[moves])
    low, high = deviation * np.maximum(1.0 - relative, _LEAST_BAR), deviation * (1.0 + relative)
    x = _log_axis(tau[0], tau[-1])
    curves = [Curve(tau, deviation, deviation), Curve(tau, low, high, joined=False)]
    ends = [low.min(), high.max()]
    if seen["white"] is not None:
        both = np.array([x.low, x.high])
        curves.append(Curve(both, *2 * (seen["white"] / np.sqrt(both),), solid=False))
        ends += (seen["white"] / np.sqrt(tau[[0, -1]])).tolist()
    return Figure(x, _log_axis(min(ends), max(ends)), "s", tuple(curves))


def _spectrum(spectrum: SpectrumSnapshot, seen: StatisticsSnapshot) -> Figure | None:
    hz, density, peak = (np.array(spectrum[key]) for key in ("hz", "density", "peak"))
    moves = density > 0.0
    if not moves.any():
        return None
    out = stands_out(spectrum) & moves
    x = _log_axis(hz[0], hz[-1])
    curves = [
        Curve(hz[moves], density[moves], density[moves]),
        Curve(hz[out], density[out], peak[out], joined=False),
    ]
    ends = [density[moves].min(), density.max(), *peak[out].tolist()]
    if seen["white"] is not None and seen["bandwidth_hz"] is not None and seen["bandwidth_hz"] > x.low:
        level = math.sqrt(2.0) * seen["white"]
        both = np.array([x.low, min(seen["bandwidth_hz"], x.high)])
        curves.append(Curve(both, *2 * (np.full(2, level),), solid=False))
        ends.append(level)
    return Figure(x, _log_axis(min(ends), max(ends)), "Hz", tuple(curves))


def _histogram(histogram: HistogramSnapshot, unit: str) -> Figure:
    bars, gauss = np.array(histogram["counts"], float), expected(histogram)
    first = histogram["edge"]
    x = Axis(first, first + len(bars) * histogram["width"], log=False)
    middles = first + (np.arange(len(bars)) + 0.5) * histogram["width"]
    y = Axis(0.0, _HEADROOM * float(max(bars.max(), gauss.max(), 1.0)), log=False)
    return Figure(x, y, "°C" if unit == "degC" else unit, (Curve(middles, gauss, gauss, solid=False),), bars)


def _log_axis(low: float, high: float) -> Axis:
    axis = axes.log_axis(float(low), float(high))
    return axis if axis.high > axis.low else Axis(axis.low / 2.0, axis.high * 2.0, log=True)
