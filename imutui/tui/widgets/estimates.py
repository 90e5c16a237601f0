"""The filter in words: verdict, NIS and its meaning, navigation states, alarms."""

from typing import Any

from textual.content import Content

from imutui.tui import text, words
from imutui.tui.link import View
from imutui.tui.widgets.lines import LEVEL_STYLES, Lines


class VerdictLine(Lines):
    """How far the filter is."""

    DEFAULT_CSS = "VerdictLine { height: 2; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """A word and a sentence; nothing before the first snapshot."""
        if view.shown is None:
            return [self.line(("No acquisition: 1 connects to one.", "dim"))]
        verdict = words.filter_verdict(view.shown.get("filter"))
        return [self.line((f"{verdict.word}  ", LEVEL_STYLES[verdict.level]), verdict.sentence)]


class NisLines(Lines):
    """Normalised innovation squared."""

    DEFAULT_CSS = "NisLines { height: 3; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """Numbers, then meaning."""
        estimates = (view.shown or {}).get("filter")
        if not estimates:
            return []
        nis = estimates["nis"]
        low, high = nis["band95"] or (None, None)
        # The band only means something for a test: shown otherwise, it invites the wrong conclusion.
        band = f"   95 % band {text.plain(low, 3)} to {text.plain(high, 3)}" if nis["is_test"] else ""
        numbers = f" mean {text.plain(nis['mean'], 3)} of {nis['dof']}{band}   first {text.plain(nis['first'], 3)}"
        return [self.line(("NIS", "bold"), numbers), self.line((words.nis_meaning(nis), "dim"))]


class NavigationLines(Lines):
    """Velocity, attitude and position, each with three standard deviations."""

    DEFAULT_CSS = "NavigationLines { height: 4; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """A head and three rows."""
        estimates = (view.shown or {}).get("filter") or {}
        head = self.rule(self._title(estimates), width, "± is 3 sd")
        state, sd = estimates.get("state"), estimates.get("state_sd")
        return [head, *(self._row(i, state, sd) for i in range(3))] if state and sd else [head]

    def _title(self, estimates: dict[str, Any]) -> str:
        if not estimates:
            return "navigation"
        samples = text.plural(estimates["samples"], "sample")
        return f"navigation: {estimates['name']}, reference {estimates['reference']}, {samples}"

    def _row(self, i: int, state: dict[str, Any], sd: dict[str, Any]) -> Content:
        position_decimals, position_unit = ((6, "°"), (6, "°"), (2, ""))[i]
        position = text.number(state["position_deg_m"][i], 11, position_decimals)
        return self.line(
            (f" {('velocity N', 'E', 'D')[i]:>10}", "bold"),
            f"{text.number(state['velocity_mps'][i], 8, 3)} ±{_three(sd['velocity_mps'][i], 3):<6}m/s",
            (f" {('roll', 'pitch', 'yaw')[i]:>6}", "bold"),
            f"{text.number(state['rpy_deg'][i], 9, 3)} ±{_three(sd['rpy_deg'][i], 3):<6}°",
            (f" {('lat', 'lon', 'h')[i]:>4}", "bold"),
            f"{position}{position_unit or ' '} ±{_three(sd['position_m'][i], 1)} m",
        )


def _three(sd: float | None, decimals: int) -> str:
    return text.NOTHING if sd is None else f"{3.0 * sd:.{decimals}f}"


class AlarmLines(Lines):
    """Alarms of the filter."""

    DEFAULT_CSS = "AlarmLines { height: 1fr; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """One alarm a line, as many as fit, and how many do not."""
        estimates = (view.shown or {}).get("filter")
        if not estimates:
            return []
        alarms = [self.line(("! ", "bold $text-error"), str(alarm)) for alarm in estimates["alarms"]]
        room = max(self.content_size.height, 1)
        if len(alarms) > room:
            rest = len(alarms) - room + 1
            alarms[room - 1 :] = [self.line((f"! and {text.plural(rest, 'more alarm')}", "bold $text-error"))]
        return alarms or [self.line(("no alarms", "dim"))]


class ToleranceLine(Lines):
    """What counts as converged."""

    DEFAULT_CSS = "ToleranceLine { height: 1; padding: 0 1; }"

    def lines(self, view: View, width: int) -> list[Content]:
        """One line."""
        gyro, accel = words.GYRO_TOLERANCE_DPS, words.ACCEL_TOLERANCE_MG
        said = f"converged: sd below {gyro:g} deg/s and {accel:g} mg.  corrected reading = reading − bias"
        return [self.line((said, "dim"))]
