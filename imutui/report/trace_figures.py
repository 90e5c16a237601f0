"""Figures of a trace, from its document alone, and of the residual of a log that was filtered."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from filters import specification
from filters.effects import plain_names
from filters.specification import ImuSpec
from filters.tracing.trace_document import (
    ChannelCurvesEntry,
    CommonEntry,
    CurveEntry,
    DriverCurveEntry,
    ErrorEntry,
    FindingEntry,
    RunCurvesEntry,
    TraceDocument,
)
from filters.types import Array
from imutui.jobs.driver_curves import TEMPERATURE, DriverCurve
from imutui.report import axes
from imutui.report.axes import AFTER, BEFORE, FLOOR, INK, SIDE_BY_SIDE, UNITS
from imutui.report.blocks import Figure, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RESIDUAL = "Reading minus what a perfect unit would read, without its mean (the bias), as means over cells"
_ALLAN = (
    "A straight line that halves when the averaging time quadruples is white noise; where it bends up, something else"
    " moves the channel."
)
_BRIDGED = " Where readings are missing, straight lines stand for them: short averaging times then look quieter."
_FEW_POINTS = 30
_REMEMBERED = " Where the error remembers temperature, a line is along a run: it comes back another way than it went."
_NOT_CHANGING = " Where rate or force changed much within the time that a point is a mean over, there is none."


def error_figure(d: TraceDocument) -> Figure | None:
    """Error of 10 s means over its floor, before and after, with intervals; None without any."""
    errors = [e for e in d["error"] if e["metric"] == "e10" and e["floor"] and e["after"] is not None]
    if not errors:
        return None
    return Figure(
        "error",
        "Error before and after, in units of its floor",
        "Bars are 95 % intervals. The grey band is where 95 % of clean units would be: a channel inside it has no error"
        " beside white noise.",
        (Panel("Error of 10 s means", partial(_errors, errors=errors)),),
    )


def figures(d: TraceDocument) -> list[Figure]:
    """All other figures."""
    return [*_drivers(d), *_commons(d), *(f for run in d["curves"] for f in _of_run(run, d))]


def of_log(curves: Mapping[str, ChannelCurvesEntry], spec: ImuSpec) -> list[Figure]:
    """Residual over time and Allan deviation of one log that was filtered, by channel; none without curves."""
    if not curves:
        return []
    return [
        Figure(
            "residual",
            "Residual",
            f"{_RESIDUAL}. A flat line is white noise; `imutui trace` looks for the cause of any other.",
            _panels(curves, partial(_residual, is_traced=False)),
        ),
        Figure(
            "allan",
            "Allan deviation of the residual",
            f"{_ALLAN} {axes.white_noise_caption([spec])}",
            _panels(curves, partial(_allan, spec=spec, is_traced=False)),
        ),
    ]


def _of_run(run: RunCurvesEntry, d: TraceDocument) -> Iterator[Figure]:
    number = 1 + [entry["run"] for entry in d["curves"]].index(run["run"])
    which = f"run {run['run']}" + (", held out" if run["heldout"] else "")
    yield Figure(
        f"residual-{number}",
        f"Residual of {which}",
        f"{_RESIDUAL} that begin and end with the readings. A flat line after is what correcting for everything found"
        " leaves.",
        _panels(run["channels"], _residual),
    )
    if number < len(d["curves"]):
        return
    bridged = _BRIDGED if any(c["bridged"] for c in run["channels"].values()) else ""
    unit = d["runs"][0]["identity"]
    spec = specification.of_model(unit["instrument"] if unit else "")
    yield Figure(
        "allan",
        f"Allan deviation of the residual of {which}",
        f"{_ALLAN} {axes.white_noise_caption([spec])}{bridged}",
        _panels(run["channels"], partial(_allan, spec=spec)),
    )
    yield Figure(
        "spectrum",
        f"Spectrum of the residual of {which}",
        "Flat is white noise; a peak is a vibration or an electrical line; a rise to the left is drift." + bridged,
        _panels(run["channels"], _spectrum),
    )


def _panels(channels: Mapping[str, ChannelCurvesEntry], draw: Callable[..., None]) -> tuple[Panel, ...]:
    return tuple(
        Panel(name, partial(draw, curves=channels[name], unit=UNITS[name[0]]))
        for name in SIDE_BY_SIDE
        if name in channels and channels[name]["residual"]["x"]
    )


def _residual(ax: "Axes", curves: ChannelCurvesEntry, unit: str, *, is_traced: bool = True) -> None:
    _drawn(ax, curves["residual"], is_traced=is_traced)
    axes.name(ax, f"s since {'power-on' if is_traced else 'the first sample'}", unit, legend=is_traced)


def _spectrum(ax: "Axes", curves: ChannelCurvesEntry, unit: str) -> None:
    x, *both = _drawn(ax, curves["spectrum"])
    axes.logarithmic(ax, "x", x)
    axes.logarithmic(ax, "y", *both)
    axes.name(ax, "frequency, Hz", f"{unit}/√Hz", legend=True)


def _allan(ax: "Axes", curves: ChannelCurvesEntry, unit: str, spec: ImuSpec, *, is_traced: bool = True) -> None:
    x, *both = _drawn(ax, curves["allan"], is_traced=is_traced)
    axes.allan(ax, x, unit, [spec], *both)


def _drawn(ax: "Axes", curve: CurveEntry, *, is_traced: bool = True) -> list[Array]:
    """Where a curve is, and the curve before and, where there was one, after correction."""
    drawn = [axes.column(curve["before"]), *([axes.column(curve["after"])] if is_traced else [])]
    axes.before_and_after(ax, curve["x"], drawn[0], drawn[1] if is_traced else None)
    return [np.asarray(curve["x"], float), *drawn]


def _errors(ax: "Axes", errors: Sequence[ErrorEntry]) -> None:
    seen: list[float] = [1.0]
    for k, e in enumerate(errors):
        floor = e["floor"] or 1.0
        band = _over(e["floor_band95"], floor)
        ax.fill_between([k - 0.42, k + 0.42], band[0] or 1.0, band[1] or 1.0, color=FLOOR, alpha=0.35, lw=0)
        for at, value, interval, color, marker in (
            (k - 0.13, e["before"], e["before_ci95"], BEFORE, "s"),
            (k + 0.13, e["after"], e["ci95"], AFTER, "o"),
        ):
            if value is None:
                continue
            ends = _over(interval, floor)
            axes.whiskers(ax, at, value / floor, ends, color, marker)
            seen += [x for x in (value / floor, *ends, *band) if x]
    ax.axhline(1.0, color=INK, lw=0.7)
    for color, marker, label in ((BEFORE, "s", "before"), (AFTER, "o", "after")):
        ax.plot([], [], color=color, marker=marker, ms=4.5, ls="none", label=label)
    axes.logarithmic(ax, "y", np.array(seen))
    axes.name(ax, "channel", "error / floor", legend=True)
    ax.set_xticks(range(len(errors)), [axes.plain(str(e["channel"])) for e in errors])


def _over(interval: Sequence[float | None] | None, floor: float) -> tuple[float | None, float | None]:
    low, high = interval or (None, None)
    return (None if low is None else low / floor), (None if high is None else high / floor)


def _drivers(d: TraceDocument) -> Iterator[Figure]:
    curves = [(f, curve) for f in d["findings"] if (curve := f["driver_curve"])]
    for n, (finding, curve) in enumerate(curves, 1):
        yield Figure(
            f"driver-{n}",
            f"{' '.join(finding['channels'])}: {finding['label']}",
            "Error over what it follows, relative to the first point; the band is two standard deviations wide on each"
            " side.",
            (Panel(finding["label"], partial(_driver, finding=finding, curve=curve)),),
        )


def _driver(ax: "Axes", finding: FindingEntry, curve: DriverCurveEntry) -> None:
    x, y = np.asarray(curve["x"], float), np.asarray(curve["y"], float)
    sd = np.asarray(curve["sd"], float) if curve["sd"] else np.zeros(x.size)
    ax.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=AFTER, alpha=0.25, lw=0)
    ax.plot(x, y, color=AFTER, lw=1.2, marker="o" if x.size < _FEW_POINTS else None, ms=3)
    ax.axhline(0.0, color=INK, lw=0.5)
    driver = curve["driver"].replace("_", " ")
    axes.name(ax, _with_unit(driver, curve["unit"]), _with_unit(" ".join(finding["channels"]), curve["y_unit"]))


def of_drivers(curves: Sequence[DriverCurve]) -> list[Figure]:
    """What errors follow and how: a figure of those of temperature and one of those of motion, where there are any."""
    made = []
    for name, title, own in (
        ("temperature", "Error over temperature", [c for c in curves if c.driver == TEMPERATURE]),
        ("motion", "Error over rate and specific force", [c for c in curves if c.driver != TEMPERATURE]),
    ):
        if not own:
            continue
        channels = {
            label: dict.fromkeys(c.channel for c in own if c.label == label) for label in (c.label for c in own)
        }
        which = "; ".join(f"{' '.join(of)}: {label}" for label, of in channels.items())
        has_past = any((np.diff(line.x) < 0.0).any() for c in own for line in c.lines)
        caption = (
            f"{which}. A line is what was fitted, the band two standard deviations wide on each side, both relative to"
            " the mean. Points are the residual before correction, but without the channel's other effects; a run's"
            f" bias is free.{_REMEMBERED if has_past else ''}"
            f"{'' if name == 'temperature' else _NOT_CHANGING}"
        )
        made.append(Figure(name, title, caption, tuple(Panel(c.channel, partial(_curve, c=c)) for c in own)))
    return made


def _curve(ax: "Axes", c: DriverCurve) -> None:
    for is_held_out, color, label in ((False, BEFORE, "runs that were fitted"), (True, INK, "held out")):
        own = [points for points in c.points if points.is_held_out is is_held_out]
        if own:
            x, y = np.concatenate([p.x for p in own]), np.concatenate([p.y for p in own])
            ax.plot(x, y, ".", ms=2.5, color=color, label=label)
    for n, (x, y, sd) in enumerate(c.lines):
        turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
        # a band that turned back over itself would be none there
        for first, last in pairwise([0, *turns.tolist(), x.size - 1]):
            part = slice(first, last + 1)
            ax.fill_between(x[part], (y - 2.0 * sd)[part], (y + 2.0 * sd)[part], color=AFTER, alpha=0.25, lw=0)
        ax.plot(x, y, color=AFTER, lw=1.2, label="" if n else "fitted")
    axes.name(ax, _with_unit(plain_names.driver(c.driver).removeprefix("the "), c.driver_unit), c.unit, legend=True)


def _commons(d: TraceDocument) -> Iterator[Figure]:
    for n, entry in enumerate(d["common"], 1):
        yield Figure(
            f"common-{n}",
            f"{' '.join(entry['channels'])} {entry['label']}",
            f"What the channels share, as it shows on {entry['channels'][0]}. Lay it beside what was logged elsewhere.",
            (Panel(entry["label"], partial(_common, entry=entry)),),
        )


def _common(ax: "Axes", entry: CommonEntry) -> None:
    t, y = np.asarray(entry["curve"]["t_s"], float), np.asarray(entry["curve"]["y"], float)
    of_run = entry["curve"]["run"] or [entry["run"] or ""] * t.size
    for run, style in zip(dict.fromkeys(of_run), ("-", "--", "-.", ":") * len(of_run), strict=False):
        own = np.array([name == run for name in of_run])
        ax.plot(t[own], y[own], lw=1.1, ls=style, color=AFTER, label=axes.plain(f"run {run}"))
    if entry["kind"] == "event":
        ax.axvspan(entry["t_start_s"], min(entry["t_end_s"], float(t[-1])), color=FLOOR, alpha=0.25, lw=0)
    axes.name(ax, "s since the start of the run", f"{entry['channels'][0]}, {entry['unit']}", legend=True)


def _with_unit(text: str, unit: str | None) -> str:
    return f"{text}, {unit}" if unit else text
