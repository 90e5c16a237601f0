"""Plots of a result: a replay's biases over time; a trace's residuals and driver curves. Pure functions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from imutui.estimate_history import EstimateHistory
from imutui.tui import formatting
from imutui.tui.widgets import history_cells, text_plot
from imutui.tui.widgets.raster import Limits, Line
from imutui.tui.widgets.text_plot import PlotLook

T = TypeVar("T")

if TYPE_CHECKING:
    from imutui.jobs.documents import CurveEntry, FindingEntry, ResultDocument, TraceDocument

NAMES = tuple(f"{axis} {kind}, {unit}" for kind, unit in (("gyro", "deg/s"), ("accel", "mg")) for axis in "xyz")
_ORDER = (0, 3, 1, 4, 2, 5)
_ROWS = 5
_TWO = 76
TWO_RESULTS = 110  # characters that plots of two results side by side need
_RUN_NAME = 18  # of a plot that has half of 80 columns


def plots(kind: str, document: Any, look: PlotLook) -> list[Line]:
    """Plots of a result of a kind; none where it has nothing to plot."""
    match kind:
        case "replay":
            return of_replay(document, look)
        case "trace":
            return of_trace(document, look)
    return []


def of_replay(d: "ResultDocument", look: PlotLook) -> list[Line]:
    """Six biases with their band over the run."""
    course = d["course"]
    if not course or not course["t"]:
        return []
    history = EstimateHistory(len(NAMES), max(len(course["t"]), 2))
    history.extend(course)
    band = "± 3 sd " + ("shaded" if look.shades else "edged")
    lines: list[Line] = [_heading(look, f"Biases over time, {band}; bold from where they are converged")]
    return lines + _grid([(NAMES[k], k) for k in _ORDER], look, lambda name, k, small: _bias(history, name, k, small))


def _bias(history: EstimateHistory, name: str, column: int, look: PlotLook) -> list[Line]:
    return text_plot.of_history(history, column, name, _ROWS, look)


def of_trace(d: "TraceDocument", look: PlotLook) -> list[Line]:
    """Driver curves with their band, residuals over time before and after."""
    return [*_drivers(d, look), *_residuals(d, look)]


def _drivers(d: "TraceDocument", look: PlotLook) -> list[Line]:
    lines: list[Line] = []
    for finding in d["findings"]:
        curve = finding["driver_curve"]
        if curve is not None and len(curve["x"]) > 1:
            lines += _driver(finding, look)
    return [_heading(look, "Error over what drives it, ± 3 sd"), *lines] if lines else []


def _driver(finding: "FindingEntry", look: PlotLook) -> list[Line]:
    curve = finding["driver_curve"]
    assert curve is not None
    unit = formatting.unit_name(curve["unit"])
    ends = f"{curve['x'][0]:.4g} {unit}", f"{curve['driver']} {curve['x'][-1]:.4g} {unit}"
    title = f"{' '.join(finding['channels'])}: {finding['label']}, {curve['y_unit']}"
    return text_plot.of_band(curve["x"], curve["y"], curve["sd"], title, ends, _ROWS, look)


def _residuals(d: "TraceDocument", look: PlotLook) -> list[Line]:
    """Each channel that has changed before and after on one scale, then those that have not."""
    changed: list[Line] = []
    unchanged: list[tuple[str, _Course]] = []
    runs = d["curves"]
    names = formatting.apart([run["run"] for run in runs], _RUN_NAME)
    for run, name in zip(runs, names, strict=True):
        held = ", held out" if run["heldout"] else ""
        of_run = f", {name}{held}" if len(runs) > 1 else held
        for channel, curves in run["channels"].items():
            curve = curves["residual"]
            title = f"{channel}, {'deg/s' if channel.startswith('g') else 'mg'}"
            if curve["x"] and curve["before"] == curve["after"]:
                unchanged.append((f"{title}: unchanged{of_run}", _Course(curve["x"], curve["before"], _limits(curve))))
            elif curve["x"]:
                both = (("before", curve["before"]), ("after", curve["after"]))
                items = [(f"{title}: {when}{of_run}", _Course(curve["x"], y, _limits(curve))) for when, y in both]
                changed += _grid(items, look, _course)
    lines = [*changed, *_grid(unchanged, look, _course)]
    heading = _heading(look, "Residuals over time: what the readings have beyond the reference")
    return [heading, *lines] if lines else []


@dataclass(frozen=True, slots=True)
class _Course:
    """A residual over time, and what its axis has to contain."""

    x: list[float]
    y: list[float | None]
    limits: Limits | None


def _limits(curve: "CurveEntry") -> Limits | None:
    known = [value for value in (*curve["before"], *curve["after"]) if value is not None]
    return (min(known), max(known)) if known else None


def _course(title: str, course: _Course, look: PlotLook) -> list[Line]:
    ends = history_cells.duration(course.x[0]), history_cells.duration(course.x[-1])
    return text_plot.of_curve(course.x, course.y, title, course.limits, ends, _ROWS, look)


def _grid(items: list[tuple[str, T]], look: PlotLook, draw: Callable[[str, T, PlotLook], list[Line]]) -> list[Line]:
    """Plots two in a row where there is room, else one under the other."""
    if look.width < _TWO:
        return [line for name, item in items for line in draw(name, item, look)]
    half = PlotLook((look.width - 2) // 2, look.glyphs, look.shades)
    lines: list[Line] = []
    for k in range(0, len(items), 2):
        blocks = [draw(name, item, half) for name, item in items[k : k + 2]]
        lines += text_plot.beside(blocks[0], blocks[1] if len(blocks) > 1 else [], half.width + 2)
    return lines


def _heading(look: PlotLook, said: str) -> Line:
    return [(look.glyphs.text(said)[: look.width], "bold")]
