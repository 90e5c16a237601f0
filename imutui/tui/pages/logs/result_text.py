"""Results of jobs as text for a page. Pure functions."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imutui.report import replay_text, trace_tables, wrapping
from imutui.report.trace_glance import Places
from imutui.tui import formatting
from imutui.tui.formatting import StyledText
from imutui.tui.pages.logs import result_plots
from imutui.tui.terminal.glyphs import choose
from imutui.tui.widgets.raster import Line
from imutui.tui.widgets.text_plot import PlotLook

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument, TraceDocument

_GAPS = 5
_PLACES = Places(
    "w writes them beside the log, e loads them into the filter",
    "x writes that motion as a profile; 5 Table guides through it",
    "which imutui report saves",
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a job came to."""

    kind: str  # "trace", "replay", "info", "check" or "recover"
    title: str  # what it is of
    log: Path  # beside which files are written, and whose name they begin with; of several logs `log_files.base`
    document: Any  # JSON-ready
    text: Callable[[int], str]  # its text at a width
    # effects, experiment: TOML of a trace's effects, and of the motion that would separate its causes; empty if there
    # is none
    effects: str = ""
    experiment: str = ""
    drawn: Callable[[PlotLook], list[Line]] | None = None  # its plots; None for those of its kind

    def plots(self, look: PlotLook) -> list[Line]:
        """Lines of its plots; none of a result that has nothing to plot."""
        return result_plots.plots(self.kind, self.document, look) if self.drawn is None else self.drawn(look)


def styled(body: str) -> StyledText:
    """Text with its headings bold: lines after an empty one that are no sentences, and what is in capitals."""
    lines = body.split("\n")
    made: StyledText = []
    for number, line in enumerate(lines):
        first = number == 0 or not lines[number - 1]
        heading = first and line and not line[0].isspace()
        loud = line.lstrip().startswith(("NOT ", "ALARM", "CANNOT"))
        made += ["\n"] if number else []
        made.append((line, "bold") if heading or loud else line)
    return made


def traced(result: "TraceDocument", writing: Collection[Path] = ()) -> Callable[[int], str]:
    """Text of a trace at a width, with what is wrong with its files first; `writing` were not finished yet."""
    told = [_as_written(sentence, writing) for sentence in result["damage"]]

    def at(width: int) -> str:
        damage = "".join(f"{wrapped(sentence, width)}\n" for sentence in told)
        return damage + trace_tables.text(result, result["source"], width, _PLACES, choose().text)

    return at


def _as_written(sentence: str, writing: Collection[Path]) -> str:
    """A file that is being written is not damaged."""
    path = next((path for path in writing if sentence.startswith(str(path))), None)
    return sentence if path is None else f"{path.name} was being written: all up to its last flush is used."


def replayed(writing: Collection[Path], d: "ResultDocument", width: int) -> str:
    """Return the text of a replay, and what is wrong with its file; those of `writing` were not finished."""
    said = replay_text.text(d, width)
    if d["damage"] is None:
        return said
    return "\n\n".join((said, wrapped(_as_written(f"{d['log']}: {d['damage']}", writing), width)))


def wrapped(body: str, width: int) -> str:
    """Lines of at most so many characters, the rest of each below it and as far in."""
    out = []
    for line in body.split("\n"):
        indent = line[: len(line) - len(line.lstrip())]
        for part in formatting.folded(line, width, indent + "  ").split("\n"):
            out += wrapping.wrap(part, width, subsequent_indent=indent + "  ") or [""]
    return "\n".join(out)
