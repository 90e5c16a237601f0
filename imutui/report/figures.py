"""Figures of a trace. The only user of matplotlib, which is an extra: `pip install 'imutui[report]'`.

No global state: figures are made by hand on Agg, and equal results give equal files.
"""

import importlib.util
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal

from filters import allan
from filters.channels import CHANNELS, STANDARD_GRAVITY
from filters.tracing.result import RunSeries
from filters.tracing.trace_document import CommonEntry, DriverCurveEntry, ErrorEntry, FindingEntry, TraceDocument
from filters.types import Array
from imutui.plain_text import in_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SCALE = np.repeat([180.0 / np.pi, 1e3 / STANDARD_GRAVITY], 3)
_UNITS = ("deg/s",) * 3 + ("mg",) * 3
# told apart by lightness too, for a grey print
_BEFORE, _AFTER, _FLOOR = "#d95f02", "#1b4f9c", "#888888"
_POINTS = 400
_DPI = 110


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure as bytes.

    Attributes
    ----------
    name : str
        Of its file, with suffix.
    title : str
        What it shows.
    png : bytes
        The picture.
    """

    name: str
    title: str
    png: bytes


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def pictures(document: TraceDocument, series: Sequence[RunSeries]) -> Iterator[Picture]:
    """All figures of a trace, one after the other.

    Parameters
    ----------
    document : TraceDocument
        Contracts section 6.
    series : sequence of RunSeries
        Residuals of all runs, the held-out one last.
    """
    for n, run in enumerate(series, 1):
        yield _picture(f"residual-{n}.png", f"Residual of run {run.run}, before and after", _residual(run))
    curves = [(f, curve) for f in document.get("findings", []) if (curve := f.get("driver_curve"))]
    for n, (finding, curve) in enumerate(curves, 1):
        title = f"{' '.join(finding['channels'])}: {finding['label']}"
        yield _picture(f"driver-{n}.png", title, _driver(finding, curve))
    for n, entry in enumerate(document.get("common", []), 1):
        title = f"{' '.join(entry['channels'])} {entry['label']}: course of what they share"
        yield _picture(f"common-{n}.png", title, _common(entry))
    if series:
        last = series[-1]
        yield _picture("spectrum.png", f"Spectrum of the residual of run {last.run}", _spectrum(last))
        yield _picture("allan.png", f"Allan deviation of the residual of run {last.run}", _allan(last))
    if document.get("findings"):
        yield _picture("scores.png", "Score of each finding and of its rivals", _scores(document["findings"]))
    errors = [e for e in document.get("error", []) if e["metric"] == "e10" and e.get("after_x_floor") is not None]
    if errors:
        yield _picture("error.png", "10 s mean error in units of its floor, before and after", _errors(errors))


def _picture(name: str, title: str, figure: "Figure") -> Picture:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return Picture(name, title, stream.getvalue())


def _six() -> "tuple[Figure, list[Axes]]":
    from matplotlib.figure import Figure

    # places are fixed: a layout that is solved for costs more than all the curves
    figure = Figure(figsize=(10.0, 8.0))
    axes = figure.subplots(3, 2, sharex=True)
    figure.subplots_adjust(0.08, 0.06, 0.98, 0.98, wspace=0.2, hspace=0.08)
    # gyros on the left, accelerometers on the right
    return figure, [axes[k % 3, k // 3] for k in range(6)]


def _residual(run: RunSeries) -> "Figure":
    figure, axes = _six()
    before, after = run.before * _SCALE, run.after * _SCALE
    # means over a few hundred stretches, each curve without its own mean (the bias): else noise hides the rest
    group = max(1, run.t.size // _POINTS)
    t = _means(run.t[:, None], group)[:, 0]
    for k, ax in enumerate(axes):
        for values, color, label in ((before, _BEFORE, "before"), (after, _AFTER, "after")):
            mean = _means(values[:, k : k + 1], group)[:, 0]
            centre = np.nanmean(mean) if np.isfinite(mean).any() else 0.0
            ax.plot(t, mean - centre, color=color, lw=0.9, label=label)
        _name(ax, k, f"{CHANNELS[k]}, {_UNITS[k]}")
    _bottom(axes, "s")
    return figure


def _driver(finding: FindingEntry, curve: DriverCurveEntry) -> "Figure":
    from matplotlib.figure import Figure

    x, y = np.asarray(curve["x"], float), np.asarray(curve["y"], float)
    sd = np.asarray(curve.get("sd") if curve.get("sd") is not None else np.zeros(x.size), float)
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    ax = figure.subplots()
    ax.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=_AFTER, alpha=0.2, lw=0, label="± 2 σ")
    ax.plot(x, y, color=_AFTER, marker="o" if x.size < 30 else None, ms=3, label=finding["label"])
    ax.axhline(0.0, color=_FLOOR, lw=0.6)
    ax.set_xlabel(f"{curve['driver']}, {curve.get('unit', '')}".rstrip(", "))
    ax.set_ylabel(f"{' '.join(finding['channels'])}, {curve.get('y_unit', '')}".rstrip(", "))
    ax.legend(frameon=False, fontsize="small")
    return figure


def _common(entry: CommonEntry) -> "Figure":
    from matplotlib.figure import Figure

    t, y = np.asarray(entry["curve"]["t_s"], float), np.asarray(entry["curve"]["y"], float)
    of_run = entry["curve"].get("run") or [entry.get("run", "")] * t.size
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    ax = figure.subplots()
    for run in dict.fromkeys(of_run):
        own = np.array([name == run for name in of_run])
        ax.plot(t[own], y[own], lw=0.9, label=_plain(f"run {run}"))
    if entry["kind"] == "event":
        ax.axvspan(entry["t_start_s"], min(entry["t_end_s"], float(t[-1])), color=_FLOOR, alpha=0.2, lw=0)
    ax.set_xlabel("s since the start of the run")
    ax.set_ylabel(f"{entry['channels'][0]}, {entry['unit']}")
    ax.grid(visible=True, lw=0.3)
    ax.legend(frameon=False, fontsize="small")
    return figure


def _spectrum(run: RunSeries) -> "Figure":
    figure, axes = _six()
    length = min(run.t.size, max(64, 1 << int(np.log2(max(64, run.t.size // 8)))))
    for k, ax in enumerate(axes):
        for values, color, label in ((run.before, _BEFORE, "before"), (run.after, _AFTER, "after")):
            f, power = signal.welch(_whole(values[:, k]) * _SCALE[k], 1.0 / run.period, nperseg=length)
            ax.loglog(f[1:], np.sqrt(np.maximum(power[1:], 1e-300)), color=color, lw=0.8, label=label)
        _name(ax, k, f"{CHANNELS[k]}, {_UNITS[k]}/√Hz")
    _bottom(axes, "Hz")
    return figure


def _allan(run: RunSeries) -> "Figure":
    figure, axes = _six()
    for values, color, label in ((run.before, _BEFORE, "before"), (run.after, _AFTER, "after")):
        whole = np.stack([_whole(column) for column in values.T], axis=1)
        tau, adev = allan.deviation(whole * _SCALE, run.period)
        for k, ax in enumerate(axes):
            ax.loglog(tau, np.maximum(adev[:, k], 1e-300), color=color, marker=".", lw=0.8, label=label)
    for k, ax in enumerate(axes):
        _name(ax, k, f"{CHANNELS[k]}, {_UNITS[k]}")
    _bottom(axes, "averaging time, s")
    return figure


def _scores(findings: Sequence[FindingEntry]) -> "Figure":
    from matplotlib.figure import Figure

    bars: list[tuple[str, float, bool]] = []
    for f in findings:
        bars.append((f"{' '.join(f['channels'])}: {f['label']}", float(f["score"]), True))
        bars += [
            (f"or: {r.get('label', r['effect'])}", float(f["score"] + r["score_difference"]), False)
            for r in f.get("rivals", [])
        ]
    figure = Figure(figsize=(9.0, 1.2 + 0.32 * len(bars)), layout="constrained")
    ax = figure.subplots()
    ax.barh(range(len(bars)), [bar[1] for bar in bars], color=[_AFTER if bar[2] else _FLOOR for bar in bars])
    ax.set_yticks(range(len(bars)), [bar[0] for bar in bars], fontsize="small")
    ax.invert_yaxis()
    ax.set_xlabel("score (accepted above 9)")
    return figure


def _errors(errors: Sequence[ErrorEntry]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    ax = figure.subplots()
    at = np.arange(len(errors))
    ax.bar(at - 0.2, [e.get("before_x_floor") or 0.0 for e in errors], 0.38, color=_BEFORE, label="before")
    ax.bar(at + 0.2, [e["after_x_floor"] or 0.0 for e in errors], 0.38, color=_AFTER, label="after")
    for k, e in enumerate(errors):
        band, floor = e.get("floor_band95"), e.get("floor")
        if band and floor and None not in band:
            ax.fill_between([k - 0.45, k + 0.45], band[0] / floor, band[1] / floor, color=_FLOOR, alpha=0.35, lw=0)
    ax.axhline(1.0, color="black", lw=0.7)
    if max(e.get("before_x_floor") or 0.0 for e in errors) > 10.0:
        ax.set_yscale("log")
    ax.set_xticks(at, [str(e.get("channel", "")) for e in errors])
    ax.set_ylabel("× floor (grey: 95 % of a clean unit)")
    ax.legend(frameon=False, fontsize="small")
    return figure


def _plain(text: str) -> str:
    """A label with text from outside: no control characters, and no formula between dollar signs."""
    return in_line(text).replace("$", r"\$")


def _means(values: Array, group: int) -> Array:
    n = len(values) // group * group
    parts = values[:n].reshape(-1, group, values.shape[1])
    good = np.isfinite(parts)
    counts = good.sum(axis=1)
    sums = np.where(good, parts, 0.0).sum(axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _whole(x: Array) -> Array:
    """A column without gaps: straight lines over what has no weight, less its mean."""
    good = np.isfinite(x)
    if not good.any():
        return np.zeros(x.size)
    k = np.arange(x.size)
    filled = np.interp(k, k[good], x[good])
    return np.asarray(filled - filled.mean())


def _name(ax: "Axes", k: int, text: str) -> None:
    ax.set_ylabel(text)
    ax.grid(visible=True, lw=0.3)
    for axis in (ax.xaxis, ax.yaxis):
        if axis.get_scale() == "log":
            axis.set_minor_formatter("")
    if k == 0:
        ax.legend(frameon=False, fontsize="small")


def _bottom(axes: "Sequence[Axes]", text: str) -> None:
    for k in (2, 5):
        axes[k].set_xlabel(text)
