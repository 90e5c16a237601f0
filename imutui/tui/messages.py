"""States said in words: what is fine, what is waited for, what to do. Pure functions of a snapshot."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from imutui.command_line import command
from imutui.session.client import EndReport, SessionError
from imutui.session.snapshot import Snapshot
from imutui.tui import formatting
from imutui.verdict.rules import STEADY_K_PER_MIN

if TYPE_CHECKING:
    from imutui.jobs.documents import RunDocument

TREND_KNOWN_S = 30.0
"""Time until the filter knows how the temperature changes."""
KILLED = "Its process was killed or broke down: it is gone, and has left no word of its end."


def temperature(seconds: float | None, slope_k_per_min: float | None) -> tuple[str, str]:
    """Whether the temperature is steady, by the slope and the limit of the verdict: word, and what it follows from.

    `seconds`: age of the acquisition.
    """
    if seconds is None:
        return "", ""
    limit = f"±{STEADY_K_PER_MIN:g} K/min"
    if slope_k_per_min is None:
        word, said = "T –", f"its trend is known after {TREND_KNOWN_S:.0f} s"
    elif abs(slope_k_per_min) <= STEADY_K_PER_MIN:
        word, said = "T steady", f"{slope_k_per_min:+.2f} K/min, within {limit}"
    else:
        word, said = "T moves", f"{slope_k_per_min:+.2f} K/min: wait until it is within {limit}"
    return word, f"{said}  on for {formatting.minutes(seconds)}"


def silence_limit_s(rate_hz: float | None) -> float:
    """Seconds without a packet that are worth a warning."""
    return max(1.0, 3.0 / rate_hz) if rate_hz else 1.0


def lost(now: Snapshot) -> str:
    """How many packets were lost: a number, or its bounds where nobody can tell."""
    certain, most = now["lost_packets"], now["lost_packets_max"]
    return f"{certain}" if certain == most else f"{certain} to {most}"


def silence(snapshot: Snapshot) -> str | None:
    """Warning about a line that fell silent or is gone, or None."""
    away = snapshot["reconnecting"]
    if snapshot["state"] == "running" and away is not None:
        return f"RECONNECTING for {away['seconds']:.0f} s: the acquisition waits for {away['waits_for']}"
    silent, rate = snapshot["silent_s"], snapshot["rate_hz"]
    # Streaming instruments send at their own, full rate whatever output rate was asked.
    limit = silence_limit_s(None if snapshot["sampling"] == "stream" else rate)
    if snapshot["state"] != "running" or silent is None or silent <= limit:
        return None
    advice = snapshot["advice"]["silence"]
    return f"NO DATA for {silent:.1f} s: {advice}{'' if advice.endswith('?') else '.'} The acquisition keeps listening."


def table_moves(snapshot: Snapshot | None) -> bool:
    """Whether the table turns under command, or is about to."""
    table = snapshot["controller"] if snapshot else None
    return table is not None and table["moves"]


def table_is_commanded(snapshot: Snapshot | None) -> bool:
    """True if it moves, or goes through a profile and may begin to turn any time: Esc stops it then."""
    guide = snapshot["guide"] if snapshot and snapshot["controller"] else None
    return table_moves(snapshot) or (guide is not None and guide["state"] in ("go", "hold"))


def investigates(snapshot: Snapshot | None) -> bool:
    """True if `imutui investigate` has the acquisition: it records, marks and ends by itself."""
    table = snapshot["controller"] if snapshot else None
    return table is not None and table["investigates"]


def ended(snapshot: Snapshot | None, error: str | None, report: EndReport | None = None) -> str:
    """Who or what ended an acquisition, or why it failed, and what became of its file.

    `error`: what a call to the acquisition came to.
    """
    recording = snapshot["recording"] if snapshot else None
    said = [_why_ended(snapshot, error, report)]
    said += [finding["text"] for finding in report["findings"]] if report else []
    if recording and report and report["result"] is not None:
        said.append(finished(report["result"]))
    elif recording and error == KILLED:
        path = recording["path"]
        said.append(f"It was recording to {path}: that file is not finished. On 6 Logs, v recovers what it holds.")
    elif recording:
        said.append(f"It was recording to {recording['path']}: `imutui check` looks at that file.")
    return "\n\n".join(said)


def _why_ended(snapshot: Snapshot | None, error: str | None, report: EndReport | None) -> str:
    failure = report["error"] if report else snapshot["error"] if snapshot else None
    by = report["ended_by"] if report else snapshot["ended_by"] if snapshot else ""
    if failure:
        return failure
    at = f" at {formatting.utc_time(report['utc'])} UTC" if report else ""
    if by:
        return f"It was ended{at} by {by}."
    return error or "It ended by itself, without an error."


def finished(result: "RunDocument") -> str:
    """Which file is finished, how much is in it, and what the filter made of it."""
    biases = ", ".join(f"{name} {values}" for name, values in final_biases(result))
    said = f"finished {result['log']}, {formatting.plural(result['samples'], 'sample')}"
    return f"{said}\n{biases}" if biases else said


def final_biases(result: "RunDocument") -> list[tuple[str, str]]:
    """The biases of a result by kind: name, and three values with their unit; empty if no filter ran."""
    if "final" not in result:
        return []
    gyro, accel = result["final"]["gyro_bias_dps"], result["final"]["accel_bias_mg"]
    return [("gyro bias", _triple(gyro, "deg/s")), ("accel bias", _triple(accel, "mg"))]


def _triple(values: list[float | None], unit: str) -> str:
    return f"{' '.join(formatting.number(value, 0, formatting.BIAS_DECIMALS[unit]) for value in values)} {unit}"


def recording_to(path: str, snapshot: Snapshot | None) -> str:
    """Which file is begun, and that the filter goes by a profile in it, if it does."""
    reference = snapshot["reference"] if snapshot else None
    if reference is None or not reference["profile"]:
        return f"recording to {path}"
    return f"recording to {path}; reference: profile {formatting.profile_name(reference['file'])}, 5 Table guides"


def left(snapshot: Snapshot | None) -> list[str]:
    """What goes on after the UI has gone, and how to come back."""
    name = snapshot["name"] if snapshot else "default"
    recording = snapshot["recording"] if snapshot else None
    goes_on = f" and records to {recording['path']}" if recording else ""
    option = () if name == "default" else ("--name", name)
    return [
        f"The acquisition goes on{goes_on}{until(snapshot)}.",
        f"Come back: {command('attach', *option)}   End it: {command('stop', *option)}",
    ]


def left_rack(batch: str, units: int) -> list[str]:
    """The same of a batch of which so many units run."""
    return [
        f"The batch {batch} goes on: {formatting.plural(units, 'unit')}.",
        f"Come back: {command('attach', '--batch', batch)}   End it: {command('stop', '--batch', batch)}",
    ]


def of_several(done: str, replies: Mapping[str, object]) -> tuple[str, str]:
    """What became of a request to several units, and its level: how many did it, and what kept the others from it."""
    failed = {name: reply for name, reply in replies.items() if isinstance(reply, Exception)}
    count = formatting.plural(len(replies), "unit")
    if not failed:
        return f"{done}: {count}", "good"
    why = [f"{name.partition(':')[2] or name}: {reply}" for name, reply in failed.items()]
    return "\n".join([f"{done}: {len(replies) - len(failed)} of {count}", *why]), "bad"


def until(snapshot: Snapshot | None) -> str:
    """How long an acquisition goes on that nobody looks at; empty if for ever."""
    seconds = snapshot["ends_unwatched_s"] if snapshot else None
    return "" if seconds is None else f" for {seconds:g} s: a virtual unit ends with its last viewer"


def fault(error: Exception) -> str:
    """What went wrong with a call to the acquisition; its own refusals say it themselves."""
    if isinstance(error, SessionError):
        return str(error)
    return f"the acquisition does not answer ({error}). It may be running all the same: `imutui status` tells."


def copied(page: str, content: str, environ: Mapping[str, str]) -> str:
    """What was copied, and what the terminal must allow for it to arrive."""
    if not content:
        return f"nothing to copy: the {page} page shows no numbers yet"
    said = f"copied {formatting.plural(len(content.splitlines()), 'line')} of {page}"
    if environ.get("TMUX"):
        return f"{said}. tmux passes it on after: tmux set -g set-clipboard on"
    if environ.get("TERM") == "linux":
        return f"{said}, but this console has no clipboard to take it"
    return f"{said} to the terminal's clipboard, if it allows that (OSC 52)"
