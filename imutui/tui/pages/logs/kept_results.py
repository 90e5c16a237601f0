"""Results that were saved beside a log, to compare another one with."""

from functools import partial
from pathlib import Path

from filters.errors import InputError
from imutui.tui.pages.logs import comparison_text, result_plots
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.widgets import text_plot
from imutui.tui.widgets.text_plot import Line, PlotLook

_MOST = 9
_FIELD = {"replay": "final", "trace": "findings"}
"""What only a result of a kind has."""


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
        return comparison_text.compared(a.kind, a.document, b.document, names)

    made = Outcome("comparison", f"{names[0]} and {names[1]}", a.log, None, text)
    return made.with_plots(partial(_plots, a, b))


def _plots(a: Outcome, b: Outcome, look: PlotLook) -> list[Line]:
    """Plots of both: side by side where there is room, else one under the other."""
    wide = look.width >= result_plots.TWO_RESULTS
    each = PlotLook((look.width - 2) // 2, look.glyphs, look.shades) if wide else look
    blocks = [[[(f"{name}: {made.title}", "bold")], *result_plots.plots(made.kind, made.document, each)]
              for name, made in (("A", a), ("B", b))]  # fmt: skip
    return text_plot.beside(blocks[0], blocks[1], each.width + 2) if wide else [*blocks[0], [("", "")], *blocks[1]]
