"""Two results of the same kind side by side: which there are, their numbers, differences over their deviation."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filters.errors import InputError
from imutui.report import trace_glance
from imutui.tui import formatting
from imutui.tui.pages.logs import result_plots
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.widgets import text_plot
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_plot import PlotLook

if TYPE_CHECKING:
    from imutui.jobs.documents import FindingEntry, ResultDocument, TraceDocument


_KEYS = (("gyro", "gyro_bias_dps", "deg/s"), ("accel", "accel_bias_mg", "mg"))
_MEANING = (
    "In sd: B - A over its own standard deviation, of which both results have their part; beyond 3, one power-on or one"
    " model is not the other's."
)
_SHARED = "Both are of the same readings: their errors are not independent, so that few sd say little."


def compared(kind: str, a: Any, b: Any, names: tuple[str, str]) -> str:
    """Text of a comparison.

    `kind`: "replay" or "trace", of both.
    `a`, `b`: documents of the results.
    `names`: what they are called.
    """
    told = [f"A: {names[0]}", f"B: {names[1]}", ""]
    lines = _replays(a, b) if kind == "replay" else _traces(a, b)
    shared = [_SHARED] if _readings(kind, a) & _readings(kind, b) else []
    return "\n".join([*told, *lines, "", _MEANING, *shared])


def length(kind: str, document: Any) -> str:
    """How long the readings are that a result is of, to tell it from others of the same name: ", 162 s"."""
    seconds = document.get("duration_s") if kind == "replay" else sum(run["seconds"] for run in document["runs"])
    return "" if seconds is None else f", {seconds:.0f} s"


def _readings(kind: str, d: Any) -> set[str]:
    logs = [d] if kind == "replay" else d.get("runs", [])
    return {log["log_sha256"] for log in logs if log.get("log_sha256")}


def _replays(a: "ResultDocument", b: "ResultDocument") -> list[str]:
    lines = [f"{'bias':<8} {'A ± 3 sd':>19} {'B ± 3 sd':>19} {'B - A':>9} {'in sd':>7}  unit"]
    for kind, key, unit in _KEYS:
        for i, axis in enumerate("xyz"):
            values = [d["final"][key][i] for d in (a, b)]  # type: ignore[literal-required]
            sds = [d["sd"][key][i] for d in (a, b)]  # type: ignore[literal-required]
            lines.append(_row(f"{axis} {kind}", values, sds, unit, formatting.BIAS_DECIMALS[unit]))
    return [*lines, "", *_run_figures(a, b)]


def _row(name: str, values: list[float | None], sds: list[float | None], unit: str, decimals: int) -> str:
    told = [f"{formatting.number(v, 9, decimals)} {_within(s, decimals):>9}" for v, s in zip(values, sds, strict=True)]
    change, in_sd = _difference(values, sds)
    return (
        f"{name:<8} {told[0]} {told[1]} {formatting.number(change, 9, decimals, sign=True)}"
        f" {formatting.number(in_sd, 7, 1, sign=True)}  {unit}"
    )


def _within(sd: float | None, decimals: int) -> str:
    return "" if sd is None else f"±{3.0 * sd:.{decimals}f}"


def _difference(values: list[float | None], sds: list[float | None]) -> tuple[float | None, float | None]:
    a, b = values
    if a is None or b is None:
        return None, None
    sd = sum(s**2 for s in sds if s is not None) ** 0.5
    return b - a, (b - a) / sd if sd > 0.0 else None


def _run_figures(a: "ResultDocument", b: "ResultDocument") -> list[str]:
    def line(name: str, what: Any) -> str:
        return f"{name:<24} {what(a)!s:>19} {what(b)!s:>19}"

    return [
        line("converged", lambda d: "yes" if d.get("converged") else "no"),
        line("last convergence, s", lambda d: _last_convergence(d)),
        line("NIS", lambda d: f"{formatting.plain(d['nis']['mean'])} of {formatting.plain(d['nis']['dof'])}"),
        line("samples", lambda d: d["samples"]),
        line("duration, s", lambda d: formatting.plain(d.get("duration_s"))),
        line("packets lost", lambda d: d["lost_packets"]),
        line("gaps", lambda d: len(d["gaps"])),
        line("outliers left out", lambda d: d["rejected"]),
        line("alarms", lambda d: len(d["alarms"])),
        line("filter", lambda d: d["filter"]),
        line("reference", lambda d: d["reference"]),
    ]


def _last_convergence(d: "ResultDocument") -> str:
    since = [t for times in d["converged_s"].values() for t in times if t is not None]
    return f"{max(since):.1f}" if since else formatting.NOTHING


def _traces(a: "TraceDocument", b: "TraceDocument") -> list[str]:
    lines = [f"{'error, x floor':<8} {'A before':>9} {'A after':>9} {'B before':>9} {'B after':>9}  A, B"]
    errors = [{e["channel"]: e for e in d.get("error", []) if e["metric"] == "e10"} for d in (a, b)]
    for channel in a.get("status", {}) | b.get("status", {}):
        told = [_times(e.get(channel), key) for e in errors for key in ("before_x_floor", "after_x_floor")]
        states = [trace_glance.status_words(d.get("status", {}).get(channel, formatting.NOTHING)) for d in (a, b)]
        lines.append(f"{channel:<14} {' '.join(f'{text:>9}' for text in told)}  {', '.join(states)}")
    return [*lines, "", *_findings(a, b)]


def _times(entry: Any, key: str) -> str:
    return formatting.plain(entry.get(key), 3) if entry else formatting.NOTHING


def _findings(a: "TraceDocument", b: "TraceDocument") -> list[str]:
    found = [{(f["effect"], *f["channels"]): f for f in d.get("findings", [])} for d in (a, b)]
    lines = ["", f"  {'effects':<10} {'A ± 3 sd':>19} {'B ± 3 sd':>19} {'B - A':>9} {'in sd':>6}  unit"]
    for key in found[0] | found[1]:
        both = [d.get(key) for d in found]
        entry = both[0] or both[1]
        assert entry is not None
        where = "" if all(both) else f" (only {'A' if both[0] else 'B'})"
        lines += ["", f"{' '.join(entry['channels'])}: {entry['label']}{where}"]
        lines += [_parameter(p["name"], both, p["unit"]) for p in entry["params"]]
    return lines[1:] if found[0] or found[1] else ["Neither found an effect."]


def _parameter(name: str, both: "list[FindingEntry | None]", unit: str) -> str:
    entries = [next((p for p in f["params"] if p["name"] == name), None) if f else None for f in both]
    values = [p["value"] if p else None for p in entries]
    sds = [p["sd"] if p else None for p in entries]
    told = [
        f"{formatting.plain(v)}" + ("" if s is None else f" ±{formatting.plain(3.0 * s, 2)}")
        for v, s in zip(values, sds, strict=True)
    ]
    change, in_sd = _difference(values, sds)
    moved = formatting.NOTHING if change is None else f"{change:+.3g}"
    return f"  {name:<10} {told[0]:>19} {told[1]:>19} {moved:>9} {formatting.number(in_sd, 6, 1, sign=True)}  {unit}"


_MOST = 9
_FIELD = {"replay": "final", "trace": "findings"}  # what only a result of a kind has


def find(shown: Outcome) -> list[Outcome]:
    """Saved results of the same kind in the folder of a result's log, newest first."""
    paths = [path for path in shown.log.parent.glob(f"*_{shown.kind}*.json") if path.is_file()]
    found = []
    for path in sorted(paths, key=lambda path: -path.stat().st_mtime)[: 2 * _MOST]:
        made = _read(path, shown.kind)
        if made is not None and made.document != shown.document:
            found.append(made)
    return found[:_MOST]


def _read(path: Path, kind: str) -> Outcome | None:
    """A saved result; None if the file is none."""
    from imutui.jobs import result_files

    try:
        found = result_files.read(path)
    except InputError:
        return None
    if len(found) != 1 or _FIELD[kind] not in found[0]:
        return None
    return Outcome(kind, path.name, path, found[0], lambda width: "")


def comparison(a: Outcome, b: Outcome) -> Outcome:
    """Two results of the same kind side by side.

    `a`, `b`: which of them is told first, and the other one.
    """
    names = a.title, b.title

    def text(width: int) -> str:
        return compared(a.kind, a.document, b.document, names)

    made = Outcome("comparison", f"{names[0]} and {names[1]}", a.log, None, text)
    return made.with_plots(partial(_plots, a, b))


def _plots(a: Outcome, b: Outcome, look: PlotLook) -> list[Line]:
    """Plots of both: side by side where there is room, else one under the other."""
    wide = look.width >= result_plots.TWO_RESULTS
    each = PlotLook((look.width - 2) // 2, look.glyphs, look.shades) if wide else look
    blocks = [[[(f"{name}: {made.title}", "bold")], *result_plots.plots(made.kind, made.document, each)]
              for name, made in (("A", a), ("B", b))]  # fmt: skip
    return text_plot.beside(blocks[0], blocks[1], each.width + 2) if wide else [*blocks[0], [("", "")], *blocks[1]]
