"""The table of biases: estimate, certainty, place within the data sheet's limit, drift, convergence."""

from textual.content import Content

from imutui.filter_snapshot import BiasSnapshot
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.filter.text import gauge
from imutui.tui.widgets.text_lines import TextLines
from imutui.verdict.rules import MOVES_SD, moved_sd

NAMES = tuple(f"{axis} {kind}" for kind in ("gyro", "accel") for axis in "xyz")
_TABLE_1 = "Table 1"
_HEAD = (
    ("  bias", 13),
    ("value", 5),
    (" ± 3 sd", 16),
    ("zero ±{}", 21),
    ("in 10 s", 13),
    ("converged at", 12),
)


def convergence(bias: BiasSnapshot) -> str:
    """Since when a bias is converged, in words."""
    if not bias["observable"]:
        return "unobservable"
    since = bias["converged_s"]
    if since is None:
        return "not yet"
    return f"{since:.1f} s" if since < 600.0 else formatting.clock(since)


class BiasTable(TextLines):
    """Estimate, certainty, place within the limit, drift and convergence of six biases, one of them selected."""

    DEFAULT_CSS = "BiasTable { width: 80; height: 7; }"

    selected = 0
    alone = False  # whether only the selected bias is shown

    def select(self, index: int, *, alone: bool) -> None:
        self.selected, self.alone = index, alone
        if self.view is not None:
            self.show(self.view)

    def lines(self, view: View, width: int) -> list[Content]:
        biases = view.estimates["biases"] if view.estimates is not None else []
        source = view.estimates.get("limits_of", _TABLE_1) if view.estimates is not None else ""
        limit = f"{source.partition(' data')[0]} limit".lstrip()
        head = "".join(self._cell(title.format(limit), cells) for title, cells in _HEAD)
        lines = [self.line((head.ljust(width), "bold underline"))]
        if view.estimates is not None and view.estimates["waiting"]:
            biases = []  # what stands there is what the filter begins with
        rows = [self._row(i, bias) for i, bias in enumerate(biases)] or [self._empty(i) for i in range(len(NAMES))]
        return lines + (rows[self.selected : self.selected + 1] if self.alone else rows)

    def _cell(self, said: str, width: int) -> str:
        """Text of a column: signs that the terminal lacks may stand as two."""
        return self.glyphs.text(said).ljust(width)

    def _label(self, index: int, name: str) -> tuple[str, str]:
        chosen = index == self.selected
        return (f"{'>' if chosen else ' '}{name:<8}", "bold reverse" if chosen else "bold")

    def _empty(self, index: int) -> Content:
        return self.line(self._label(index, NAMES[index]), f"{formatting.NOTHING:>9}")

    def _row(self, index: int, bias: BiasSnapshot) -> Content:
        unit, limit, value, sd3 = bias["unit"], bias["limit"], bias["value"], bias["sd3"]
        decimals = formatting.BIAS_DECIMALS[unit]
        outside = value is not None and abs(value) > limit
        pending = bias["observable"] and bias["converged_s"] is None
        moved = moved_sd(bias)
        in_sd = (
            f"{formatting.fitting(abs(moved), 3, 1).strip()} sd" if moved is not None and abs(moved) >= MOVES_SD else ""
        )
        return self.line(
            self._label(index, bias["name"]),
            (formatting.aligned(value, 9, decimals, 4), "bold"),
            self._cell(f" ±{formatting.number(sd3, 0, decimals)}", 10) + f"{unit:<6}",
            (gauge(value, limit, sd3), "bold $text-error" if outside else "$text-primary"),
            self._cell(f" ±{limit:g}", 5),
            _moved(bias["change_10s"], decimals),
            f"{in_sd:>7} ",
            (f"{convergence(bias):<12}", _style(pending, bias["observable"])),
        )


def _moved(change: float | None, decimals: int) -> str:
    """A change in eight characters, its decimal point where small ones of the gyros have it."""
    made = formatting.aligned(change, 8, decimals, 4, sign=True)
    return made if len(made) <= 8 else formatting.fitting(change, 8, decimals, sign=True)


def _style(pending: bool, observable: bool) -> str:
    # the column's words say the same
    return "$text-warning" if pending else "$text-success" if observable else "dim"
