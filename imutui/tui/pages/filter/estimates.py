"""The filter in lines: its biases, NIS and its meaning, what is unexplained, navigation states, effects, alarms."""

from textual.content import Content

from imutui.estimates import NAMES, Bias, FilterSnapshot, live_biases, specification_of
from imutui.report import effect_words, wrapping
from imutui.tui import formatting
from imutui.tui.connection.model import View
from imutui.tui.pages.filter.text import gauge
from imutui.tui.widgets.text_lines import LEVEL_STYLES, TextLines
from imutui.verdict.rules import (
    LEVEL_MARKS,
    MOVES_SD,
    NOTICED,
    Check,
    Verdict,
    held_text,
    moved_sd,
    nis_meaning,
    worst_remainder,
)

_LABEL = 13


class NisLines(TextLines):
    """NIS, its meaning and updates that were left out; what the model leaves unexplained, and what finds the cause."""

    DEFAULT_CSS = "NisLines { height: 2; }"

    def lines(self, view: View, width: int) -> list[Content]:
        estimates = view.estimates
        return [] if estimates is None else [self._nis(estimates, width), self._unexplained(view, estimates, width)]

    def _nis(self, estimates: FilterSnapshot, width: int) -> Content:
        nis = estimates["nis"]
        # the band only means something for a test: shown otherwise, it invites the wrong conclusion
        left = self.line(
            (" NIS".ljust(_LABEL), "bold"),
            f"{formatting.fitting(nis['mean'], 4, 2).strip()} of {nis['dof']:g}  ",
            (nis_meaning(nis), "dim" if not nis["is_test"] else ""),
        )
        first = nis["first"]
        small = first is None or first < 1e3
        begun = f"  first {formatting.number(first, 0, 2) if small else formatting.plain(first, 3)}"
        gates = (f"  gates {estimates['rejected']}", "bold $text-warning" if estimates["rejected"] else "")
        return self.spread(left, self.line(begun, gates, " "), width)

    def _unexplained(self, view: View, estimates: FilterSnapshot, width: int) -> Content:
        """An effect that shows, or the worst channel in units of what noise allows; the key that looks for causes."""
        worst = worst_remainder(estimates["remainder"])
        said, loud = "known after 30 s of estimates", False
        if worst is not None:
            channel, ratio = worst
            said, loud = f"{channel} 10 s means {ratio:.1f} × what noise allows", ratio > NOTICED
        key = "t traces this recording " if view.recording is not None else "r records, then t traces "
        key = "6 Logs, t traces " if view.now is not None and view.now["state"] == "ended" else key
        above = view.shown_verdict.reason if view.shown_verdict is not None else ""
        showing = [one["text"] for one in estimates["causes"] if one["shows"] and one["text"] not in above]
        if showing:
            said, loud = _cut(self.glyphs.text("; ".join(showing)), width - _LABEL - len(key) - 1), True
        left = self.line((" unexplained".ljust(_LABEL), "bold"), (said, "bold $text-warning" if loud else ""))
        return self.spread(left, self.line((key, "dim")), width)


class NavigationLines(TextLines):
    """Velocity, attitude and position, each with three standard deviations."""

    DEFAULT_CSS = "NavigationLines { height: 4; }"

    def lines(self, view: View, width: int) -> list[Content]:
        estimates = view.estimates
        head = self.rule(self._title(estimates), width, "± is 3 sd")
        if estimates is None or not estimates["samples"] or estimates["held_since_s"] is not None:
            return [head]
        return [head, *(self._row(i, estimates) for i in range(3))]

    def _title(self, estimates: FilterSnapshot | None) -> str:
        if estimates is None:
            return "navigation"
        held = held_text(estimates["held_since_s"])
        if held is not None:
            return f"navigation: {held}"
        samples = formatting.plural(estimates["samples"], "sample")
        return f"navigation: {estimates['filter']}, reference {estimates['reference']}, {samples}"

    def _row(self, i: int, estimates: FilterSnapshot) -> Content:
        state, sd, degree = estimates["final"], estimates["sd"], self.glyphs.text("°")
        decimals, unit = (2, " " * len(degree)) if i == 2 else (6 if len(degree) == 1 else 5, degree)
        return self.line(
            (f"{('velocity N', 'E', 'D')[i]:>10}", "bold"),
            _apart(state["velocity_mps"][i], 7, 3) + self._certain(sd["velocity_mps"][i], 3, 7) + "m/s",
            (f"{('roll', 'pitch', 'yaw')[i]:>6}", "bold"),
            _apart(state["rpy_deg"][i], 8, 3) + self._certain(sd["rpy_deg"][i], 3, 7) + "deg",
            (f"{('lat', 'lon', 'h')[i]:>4}", "bold"),
            f"{_apart(state['position_deg_m'][i], 11 if len(degree) == 1 else 10, decimals)}{unit}"
            f"{self._certain(sd['position_m'][i], 1, 5).rstrip()} m",
        )

    def _certain(self, sd: float | None, decimals: int, width: int) -> str:
        """Three standard deviations in a column of so many characters and a space."""
        three = None if sd is None else 3.0 * sd
        fitted = formatting.fitting(three, width - 1, decimals).strip()
        return self.glyphs.text(f" ±{fitted}").ljust(width + 2)


def _apart(value: float | None, width: int, decimals: int) -> str:
    """A number in a column that begins with a space, whatever the number is."""
    return " " + formatting.fitting(value, width - 1, decimals)


def side_by_side(said: list[str], width: int, rows: int) -> list[str]:
    """Entries beside each other in at most `rows` lines; the last line says how many have no room."""
    lines: list[str] = []
    for i, one in enumerate(said):
        rest = f"   w: {len(said) - i} more"
        last = len(lines) >= rows
        joined = f"{lines[-1]}   {one}" if lines else one
        if lines and len(joined) + (len(rest) if last and i < len(said) - 1 else 0) <= width:
            lines[-1] = joined
        elif not last:
            lines.append(one)
        else:
            lines[-1] += rest
            break
    return lines


class GrowingLines(TextLines):
    """Lines that take no more room than they need, none if there are none; a tall terminal has room for more."""

    few, many = 1, 3

    @property
    def rows(self) -> int:
        return self.many if self.screen.has_class("-tall") else self.few

    def show(self, view: View) -> None:
        """Take a view; other lines change the page's layout."""
        before = self._made
        super().show(view)
        self.display = self._made is not None and bool(self._made.plain)
        if before is None or self._made is None or before.plain != self._made.plain:
            self.refresh(layout=True)


class EffectLines(GrowingLines):
    """Effects that joined the filter; no line without effects."""

    DEFAULT_CSS = "EffectLines { height: auto; }"

    def lines(self, view: View, width: int) -> list[Content]:
        effects = view.estimates["effects"] if view.estimates is not None else []
        said = [self.glyphs.text(effect_words.estimate(effect)) for effect in effects]
        heads = [" effects", *[""] * self.rows]
        rows = side_by_side(said, width - _LABEL - 1, self.rows)
        return [self.line((f"{head:<{_LABEL}}", "bold"), row) for head, row in zip(heads, rows, strict=False)]


class AlarmLines(GrowingLines):
    """Alarms beside the one that the badge says."""

    DEFAULT_CSS = "AlarmLines { height: auto; }"
    few, many = 2, 6

    def lines(self, view: View, width: int) -> list[Content]:
        said = view.shown_verdict.reason if view.shown_verdict is not None else ""
        wrapped = [
            line
            for alarm in (view.estimates["alarms"] if view.estimates is not None else [])
            if alarm not in said
            for line in wrapping.wrap(alarm, width, initial_indent=" ! ", subsequent_indent="   ")
        ]
        if len(wrapped) > self.rows:
            wrapped = [*wrapped[: self.rows - 1], f"{wrapped[self.rows - 1][: width - 14]} … w: more"]
        return [self.line((line, "$text-error")) for line in wrapped]


_STYLES = {"good": "$success", "wait": "$warning", "bad": "$error", "none": "$foreground"}
_LEAST = 16
_WHY = "  w why "


class FilterBadge(TextLines):
    """The verdict on the filter in two lines: word, reason, and what to do."""

    DEFAULT_CSS = "FilterBadge { height: 2; }"

    def lines(self, view: View, width: int) -> list[Content]:
        verdict = view.shown_verdict
        if verdict is None:
            return [self.line((" – OFF ", "bold reverse"), "  no acquisition: 1 connects to one")]
        # without colour, the reverse of a colour is grey on grey
        style = "bold reverse" if self.app.no_color else f"bold reverse {_STYLES[verdict.level]}"
        chip = self.line((f" {verdict.badge} ", style))
        indent = chip.cell_length + 2
        said = self.glyphs.text(_said(view, verdict))
        first, second = two_lines(said, width - indent - 1, width - indent - len(_WHY))
        why = self.line((_WHY, "dim"))
        return [
            Content.assemble(chip, "  ", (first, "bold")),
            self.spread(Content(" " * indent + second), why, width),
        ]


def _said(view: View, verdict: Verdict) -> str:
    now = view.verdict
    changed = f"(frozen; now {now.badge}) " if view.frozen and now is not None and now.word != verdict.word else ""
    return f"{changed}{verdict.reason}\n{verdict.todo}"


def two_lines(said: str, first: int, second: int) -> tuple[str, str]:
    """A reason and what to do as two lines at most: what to do begins a line of its own if the reason leaves one.

    A long reason is cut so that what to do has room beside it; the key `w` has all of it.

    `said`: reason, line feed, what to do.
    """
    reason, _, todo = said.partition("\n")
    if len(reason) <= first:
        return reason, _cut(todo, second)
    cut = reason.rfind(" ", 0, first + 1)
    cut = cut if cut > 0 else first
    rest = reason[cut:].strip()
    room = second - len(todo) - 2
    if not todo or room < _LEAST:
        return reason[:cut], _cut(rest, second)
    return reason[:cut], f"{_cut(rest, room)}; {todo}"


def _cut(said: str, width: int) -> str:
    """At most `width` characters, cut behind a word."""
    if len(said) <= width:
        return said
    cut = said.rfind(" ", 0, width - 1)
    return f"{said[: cut if cut > 0 else width - 2].rstrip(' ;,:')} …"


class RuleLines(TextLines):
    """Why the badge is what it is, beside the table: a head, and each rule with what it found."""

    DEFAULT_CSS = "RuleLines { height: 100%; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        verdict = view.shown_verdict
        if verdict is None:
            return []
        head = self.line((f"why {verdict.badge}".ljust(width), "bold underline"))
        return [head, *(line for check in verdict.checks for line in self._rule(check, width))]

    def _rule(self, check: Check, width: int) -> list[Content]:
        mark = f"{LEVEL_MARKS[check.level]:<5}"
        said = wrapping.wrap(f"{check.name}: {check.said}", max(width - len(mark), 10))
        style = LEVEL_STYLES[check.level] if check.level != "none" else ""
        return [self.line((mark if i == 0 else " " * len(mark), style), line) for i, line in enumerate(said)]


# ------------------------------------------------------------------------------------------------------------- biases
# The table of biases: estimate, certainty, place within the data sheet's limit, drift, convergence.

_HEAD = (("  bias", 13), ("value", 5), (" ± 3 sd", 16), ("zero ±{}", 21), ("in 10 s", 13), ("converged at", 12))


def convergence(bias: Bias, fault: str | None) -> str:
    """Return since when a bias is converged, in words.

    `fault`: why its channel has no bias; None for a channel that measures something.
    """
    if fault is not None:
        return fault
    if not bias.observable:
        return "unobservable"
    since = bias.converged_s
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
        biases = live_biases(view.estimates) if view.estimates is not None else []
        source = specification_of(view.estimates).source if view.estimates is not None else ""
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

    def _row(self, index: int, bias: Bias) -> Content:
        unit, limit, value, sd3 = bias.unit, bias.limit, bias.value, bias.sd3
        decimals = formatting.BIAS_DECIMALS[unit]
        outside = value is not None and limit is not None and abs(value) > limit
        pending = bias.observable and bias.converged_s is None
        fault = self.view.fault_of(bias.channel) if self.view is not None else None
        moved = moved_sd(bias)
        in_sd = (
            f"{formatting.fitting(abs(moved), 3, 1).strip()} sd" if moved is not None and abs(moved) >= MOVES_SD else ""
        )
        return self.line(
            self._label(index, bias.name),
            (formatting.aligned(value, 9, decimals, 4), "bold"),
            self._cell("" if sd3 is None else f" ±{formatting.number(sd3, 0, decimals)}", 10) + f"{unit:<6}",
            (gauge(value, limit, sd3), "bold $text-error" if outside else "$text-primary"),
            self._cell(f" ±{formatting.NOTHING if limit is None else format(limit, 'g')}", 5),
            _moved(bias.change_10s if fault is None else None, decimals),
            f"{in_sd:>7} ",
            (f"{convergence(bias, fault):<12}", "$text-error" if fault else _style(pending, bias.observable)),
        )


def _moved(change: float | None, decimals: int) -> str:
    """A change in eight characters, its decimal point where small ones of the gyros have it."""
    made = formatting.aligned(change, 8, decimals, 4, sign=True)
    return made if len(made) <= 8 else formatting.fitting(change, 8, decimals, sign=True)


def _style(pending: bool, observable: bool) -> str:
    # the column's words say the same
    return "$text-warning" if pending else "$text-success" if observable else "dim"
