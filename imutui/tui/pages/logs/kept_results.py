"""Results that were saved beside a log, to compare another one with."""

import json
from functools import partial
from pathlib import Path

from imutui import outside_file
from imutui.tui.pages.logs import comparison_text, result_plots
from imutui.tui.pages.logs.result_text import Outcome
from imutui.tui.widgets import text_plot
from imutui.tui.widgets.text_plot import Line, PlotLook

_MOST = 9
_LARGEST = 64 * 2**20
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
    try:
        document = json.loads(outside_file.read(path, _LARGEST))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(document, dict) or _FIELD[kind] not in document:
        return None
    return Outcome(kind, path.name, path, document, lambda width: "")


def comparison(a: Outcome, b: Outcome) -> Outcome:
    """Two results of the same kind side by side.

    `a`, `b`: which of them is told first, and the other one.
    """
    names = a.title, b.title

    def text(width: int) -> str:
        try:
            return comparison_text.compared(a.kind, a.document, b.document, names)
        except (KeyError, TypeError, ValueError, AttributeError):
            return f"{b.title} is no result of a {a.kind} that this version can read: make it anew."

    made = Outcome("comparison", f"{names[0]} and {names[1]}", a.log, None, text)
    return made.with_plots(partial(_plots, a, b))


def _plots(a: Outcome, b: Outcome, look: PlotLook) -> list[Line]:
    """Plots of both: side by side where there is room, else one under the other."""
    wide = look.width >= result_plots.TWO_RESULTS
    each = PlotLook((look.width - 2) // 2, look.glyphs, look.shades) if wide else look
    try:
        blocks = [[[(f"{name}: {made.title}", "bold")], *result_plots.plots(made.kind, made.document, each)]
                  for name, made in (("A", a), ("B", b))]  # fmt: skip
    except (KeyError, TypeError, ValueError, AttributeError):
        return []
    return text_plot.beside(blocks[0], blocks[1], each.width + 2) if wide else [*blocks[0], [("", "")], *blocks[1]]
