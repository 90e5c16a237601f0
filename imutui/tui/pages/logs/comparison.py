"""Two results of the same kind side by side: which there are, what the report says of both, and their plots."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from filters.errors import InputError
from imutui.jobs import result_files
from imutui.jobs.page_data import LogData
from imutui.report import plain, trace_glance
from imutui.report.blocks import Figure
from imutui.tui import formatting
from imutui.tui.pages.logs import result_plots
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets import text_plot
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_plot import PlotLook

if TYPE_CHECKING:
    from imutui.jobs.documents import FindingEntry, TraceDocument

_MEANING = (
    "In sd: B - A over its own standard deviation, of which both results have their part; beyond 3, one power-on or one"
    " model is not the other's."
)
_SHARED = "Both are of the same readings: their errors are not independent, so that few sd say little."
_MOST = 9
_FIELD = {"replay": "final", "trace": "findings"}  # what only a result of a kind has


def length(kind: str, document: Any) -> str:
    """How long the readings are that a result is of, to tell it from others of the same name: ", 162 s"."""
    seconds = document["duration_s"] if kind == "replay" else sum(run["seconds"] for run in document["runs"])
    return "" if seconds is None else f", {seconds:.0f} s"


def find(shown: Outcome) -> list[Outcome]:
    """Saved results of the same kind in the folder of a result's log, newest first."""
    paths = [path for path in shown.log.parent.glob(f"*_{shown.kind}*.json") if path.is_file()]
    found = []
    for path in sorted(paths, key=lambda path: -path.stat().st_mtime)[: 2 * _MOST]:
        try:
            documents = result_files.read(path)
        except InputError:
            continue
        if len(documents) == 1 and _FIELD[shown.kind] in documents[0] and documents[0] != shown.document:
            found.append(Outcome(shown.kind, path.name, path, documents[0], lambda width: ""))
    return found[:_MOST]


def comparison(a: Outcome, b: Outcome) -> Outcome:
    """Two results of the same kind side by side. Blocks, so it is called in a thread: the report loads much."""
    body = _replays(a.document, b.document) if a.kind == "replay" else _traces(a.document, b.document)

    def text(width: int) -> str:
        return f"A: {a.title}\nB: {b.title}\n\n{body(width)}"

    def plots(look: PlotLook) -> list[Line]:
        """Side by side where there is room, else one under the other."""
        wide = look.width >= result_plots.TWO_RESULTS
        each = PlotLook((look.width - 2) // 2, look.glyphs, look.shades) if wide else look
        first, second = (
            [[(f"{name}: {made.title}", "bold")], *result_plots.plots(made.kind, made.document, each)]
            for name, made in (("A", a), ("B", b))
        )
        return text_plot.beside(first, second, each.width + 2) if wide else [*first, [("", "")], *second]

    return Outcome("comparison", f"{a.title} and {b.title}", a.log, None, text, drawn=plots)


def _replays(a: Any, b: Any) -> Callable[[int], str]:
    """As the report has them; who they are comes last, as their names stand above."""
    from imutui.report import comparison as report

    article = report.article([a, b], [LogData()] * 2)
    assert article is not None
    sections = [
        replace(section, blocks=tuple(block for block in section.blocks if not isinstance(block, Figure)))
        for section in (*article.sections[1:], article.sections[0])
    ]
    return lambda width: plain.text(sections, width, choose().text)


def _traces(a: "TraceDocument", b: "TraceDocument") -> Callable[[int], str]:
    """Errors of channels, then parameters of effects; the report's tables take more columns than a terminal has."""
    lines = [f"{'error, x floor':<8} {'A before':>9} {'A after':>9} {'B before':>9} {'B after':>9}  A, B"]
    errors = [{e["channel"]: e for e in d["error"] if e["metric"] == "e10"} for d in (a, b)]
    for channel in a["status"] | b["status"]:
        told = [_times(e.get(channel), key) for e in errors for key in ("before_x_floor", "after_x_floor")]
        states = [trace_glance.status_words(d["status"].get(channel, formatting.NOTHING)) for d in (a, b)]
        lines.append(f"{channel:<14} {' '.join(f'{text:>9}' for text in told)}  {', '.join(states)}")
    shas = [{run["log_sha256"] for run in d["runs"] if run["log_sha256"]} for d in (a, b)]
    said = "\n".join([*lines, "", *_findings(a, b), "", _MEANING, *([_SHARED] if shas[0] & shas[1] else [])])
    return lambda width: said


def _times(entry: Any, key: str) -> str:
    return formatting.plain(entry.get(key), 3) if entry else formatting.NOTHING


def _findings(a: "TraceDocument", b: "TraceDocument") -> list[str]:
    found = [{(f["effect"], *f["channels"]): f for f in d["findings"]} for d in (a, b)]
    lines = [f"  {'effects':<10} {'A ± 3 sd':>19} {'B ± 3 sd':>19} {'B - A':>9} {'in sd':>6}  unit"]
    for key in found[0] | found[1]:
        both = [d.get(key) for d in found]
        entry = both[0] or both[1]
        assert entry is not None
        where = "" if all(both) else f" (only {'A' if both[0] else 'B'})"
        lines += ["", f"{' '.join(entry['channels'])}: {entry['label']}{where}"]
        lines += [_parameter(p["name"], both, p["unit"]) for p in entry["params"]]
    return lines if found[0] or found[1] else ["Neither found an effect."]


def _parameter(name: str, both: "list[FindingEntry | None]", unit: str) -> str:
    from imutui.report.comparison_figures import difference

    entries = [next((p for p in f["params"] if p["name"] == name), None) if f else None for f in both]
    (a, a_sd), (b, b_sd) = [(p["value"], p["sd"]) if p else (None, None) for p in entries]
    told = [
        formatting.plain(value) + ("" if sd is None else f" ±{formatting.plain(3.0 * sd, 2)}")
        for value, sd in ((a, a_sd), (b, b_sd))
    ]
    change, sd = difference((a, a_sd), (b, b_sd), related=False)
    moved = formatting.NOTHING if change is None else f"{change:+.3g}"
    in_sd = formatting.number(change / sd if change is not None and sd else None, 6, 1, sign=True)
    return f"  {name:<10} {told[0]:>19} {told[1]:>19} {moved:>9} {in_sd}  {unit}"
