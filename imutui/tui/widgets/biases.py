"""The table of biases: estimate, certainty, place within the data sheet's limit, drift, convergence."""

from typing import Any

from textual.content import Content

from imutui.tui import text
from imutui.tui.link import View
from imutui.tui.widgets.lines import Lines

_CELLS = 11
_NAMES = tuple(f"{axis} {kind}" for kind in ("gyro", "accel") for axis in "xyz")


def gauge(value: float | None, limit: float) -> str:
    """Bar from zero in the middle towards the value; ends are the limits, a value beyond them puts ▲ there."""
    middle = _CELLS // 2
    cells = ["·"] * _CELLS
    cells[middle] = "│"
    if value is not None:
        reach = round(abs(value) / limit * middle)
        step = 1 if value > 0 else -1
        for i in range(1, min(reach, middle) + 1):
            cells[middle + step * i] = "█"
        if abs(value) > limit:
            cells[middle + step * middle] = "▲"
    return f"▕{''.join(cells)}▏"


def convergence(bias: dict[str, Any]) -> str:
    """Since when a bias is converged, in words."""
    if not bias["observable"]:
        return "not observable"
    if bias["converged_s"] is None:
        return "not yet"
    return f"since {bias['converged_s']:.1f} s"


class BiasTable(Lines):
    """Seven lines: a head and six biases."""

    DEFAULT_CSS = "BiasTable { width: 80; height: 7; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Head and biases; dashes while nothing is known."""
        estimates = (view.shown or {}).get("filter") or {}
        biases = estimates.get("biases") or []
        head = "             bias  ±3 sd         zero ± Table 1 limit      in 10 s   converged"
        lines = [self.line((head.ljust(width), "bold underline"))]
        if not biases:
            return lines + [self.line((f" {name:<8}", "bold"), f"{text.NOTHING:>8}") for name in _NAMES]
        return lines + [self._row(bias) for bias in biases]

    def _row(self, bias: dict[str, Any]) -> Content:
        unit, limit, value = bias["unit"], bias["limit"], bias["value"]
        decimals = text.BIAS_DECIMALS[unit]
        sd3 = bias["sd3"]
        outside = value is not None and abs(value) > limit
        pending = bias["observable"] and bias["converged_s"] is None
        return self.line(
            (f" {bias['name']:<8}", "bold"),
            (text.aligned(value, 9, decimals, 4), "bold"),
            f" ±{text.NOTHING if sd3 is None else f'{sd3:.{decimals}f}':<7}{unit:<6}",
            (gauge(value, limit), "bold $text-error" if outside else "$text-primary"),
            f" ±{limit:<4g}",
            text.aligned(bias["change_10s"], 10, decimals, 4, sign=True),
            "   ",
            (convergence(bias), _style(pending, bias["observable"])),
        )


def _style(pending: bool, observable: bool) -> str:
    # the column's words say the same
    return "$text-warning" if pending else "$text-success" if observable else "dim"
