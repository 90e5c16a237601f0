"""The verdict on the result of a run that is over, in words: its headline, its reasons, and beside which limits."""

from typing import TYPE_CHECKING

from filters import specification
from filters.channels import DPS
from imutui.estimates import RunFields, specification_of
from imutui.verdict.rules import TRACE_KEY, Verdict, judge

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_NO_FILTER = "no filter ran: readings were taken, nothing was estimated"


def of_document(d: "RunDocument") -> Verdict:
    """Return the verdict on a live run that is over, or on a replay."""
    if "final" in d:
        return judge(d, d["health"])
    if d["health"]:
        return judge(None, d["health"])
    if d["alarms"]:
        return Verdict("bad", "RED", d["alarms"][0], "imutui replay makes the estimates")
    return Verdict("none", "OFF", _NO_FILTER)


def noise_stated(d: RunFields) -> tuple[str, str]:
    """Return the white noise of the unit's data sheet in words: gyros, deg/√h, and accelerometers, m/s/√h.

    Where no data sheet is known, it is what the filter expects instead.
    """
    spec = specification_of(d)
    of = "the filter expects" if spec == specification.NOT_KNOWN else f"{spec.source.removesuffix(' data sheet')}:"
    return f"{of} {spec.gyro_arw / DPS * 60.0:.3g}", f"{of} {spec.accel_vrw * 60.0:.3g}"


def headline(d: "RunDocument") -> str:
    """Return the verdict on a result in a line: word, whether it converged, of what part, the file.

    "Converged" stands above nothing that is RED, and above a damaged file only with the part that could be read.
    """
    found = of_document(d)
    if found.word == "OFF":
        return f"no filter: {d['log']}"
    said = f"{found.word}, {found.fault}" if found.fault else found.word
    if found.level != "bad" and "final" in d:
        settled = all(check.level == "good" for check in found.checks if check.name == "converged")
        said += ", converged" if settled else ", NOT converged"
    if d["damage"] is not None and "final" in d:
        said += f" in the {d['duration_s']:.1f} s of it that can be read"
    return f"{said}: {d['log']}"


def reasons(d: "RunDocument") -> str:
    """Return why the verdict on a result is what it is, and what to do: a sentence for below its headline."""
    found = of_document(d)
    todo = found.todo_at_length.replace(TRACE_KEY, "`imutui trace` looks for the cause")
    return found.followed_by(todo)


def hence(d: "RunDocument") -> str:
    """Return why a command that ends with this result exits with 1: the verdict's word and reason."""
    found = of_document(d)
    return f"{found.word}: {found.reason}"
