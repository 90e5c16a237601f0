"""What to do after a trace or a replay, in the order in which to do it: sentences made of the result document alone."""

from collections.abc import Iterator
from pathlib import PurePath
from typing import TYPE_CHECKING

from filters.effects import plain_names
from filters.tracing.sentence import OF_ONE_RUN
from filters.tracing.trace_document import SEPARATES, TraceDocument
from imutui.report import sentences
from imutui.report.numbers import duration
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.jobs.documents import ResultDocument

NOTHING = "Nothing has to be corrected beside constant biases: estimate them as each run begins, as the filter does."


def after_trace(d: TraceDocument) -> list[str]:
    """What to do after a trace.

    `d`: the result.
    """
    told = [*_data(d), *_use(d), *_leave_out(d), *_separate(d), *_log_more(d), *_drift(d), *_second_run(d)]
    return told or [NOTHING]


def after_replay(d: "ResultDocument") -> list[str]:
    """What to do after a replay.

    `d`: the result; one in which a filter ran.
    """
    log = PurePath(d["log"]).name
    told = []
    if "damage" in d:
        told.append(
            f"The file is damaged. `imutui recover {log} -o WHOLE.mcap` makes a whole file of what can be read."
        )
    found = sources.of_document(d)
    if found.level == "bad":
        told.append(
            f"Do not use these biases as they are: readings and model contradict each other. `imutui trace {log}` looks"
            " for the cause."
        )
    elif found.passes:
        told.append(
            "Subtract the biases of the table below: corrected reading = reading − bias, in the unit's own axes."
        )
    else:
        told.append(
            "Do not use a bias that has not converged: record longer, with the unit warmed up. A bias that keeps moving"
            f" follows something; `imutui trace {log}` looks for what it is."
        )
    if d.get("unobservable"):
        told.append(
            f"To see {', '.join(_plain(name) for name in d['unobservable'])} as well, record on a table whose attitude"
            " is known (`--reference level`, or a table profile)."
        )
    told += [f"{sentence}: another motion tells them apart." for sentence in d.get("confounded", [])]
    if d["lost_packets"] or d["bad_checksums"]:
        told.append(
            f"{d['lost_packets']} packets were lost and {d['bad_checksums']} had bad checksums: look at cable, adapter"
            " and supply."
        )
    return told


def _plain(name: str) -> str:
    return name.replace("_bias", " bias").replace("_", " ")


def _data(d: TraceDocument) -> Iterator[str]:
    for entry in d.get("integrity", []):
        where = f", {entry['where']}" if entry.get("where") else ""
        yield (
            f"Look at the data first: {plain_names.effect(entry['effect'])} on {_names(entry['channels'])}{where}."
            " Check cable, connector and supply before the next recording."
        )


def _use(d: TraceDocument) -> Iterator[str]:
    held = [f for f in d.get("findings", []) if f.get("confirmed") is not False]
    used = [f for f in held if f["effect"] not in OF_ONE_RUN]
    if used:
        what = "; ".join(f"{_names(f['channels'])}: {plain_names.named(f['label'], f['effect'])}" for f in used)
        file = (
            "`effects.toml` beside this page has it"
            if d.get("effects_file")
            else "`imutui trace` with the same logs and `-o effects.toml` writes it"
        )
        yield (
            f"Correct for what was found ({what}): {file}, and `imutui record`, `imutui replay` and `imutui apply` take"
            " it with `--effects effects.toml`."
        )
    for f in held:
        if f["effect"] in OF_ONE_RUN:
            yield (
                f"{_names(f['channels'])}: {plain_names.named(f['label'], f['effect'])}. It happened in this run, and"
                " says nothing of the next: it is not in the effects file. Look for what happened then."
            )
    odd = [f for f in used if any(p.get("plausible") is False for p in f.get("params", []))]
    for f in odd:
        yield (
            f"{_names(f['channels'])}: “{f['label']}” comes out larger than this physics allows. Treat it as a curve"
            " that fits, not as a cause, and look for what else it may be."
        )


def _leave_out(d: TraceDocument) -> Iterator[str]:
    names = [
        *(f"{_names(x['channels'])}: {x['label']} (it makes the held-out run worse)" for x in d.get("refuted", [])),
        *(
            f"{_names(f['channels'])}: {f['label']} (the held-out run does not confirm it)"
            for f in d.get("findings", [])
            if f.get("confirmed") is False
        ),
    ]
    if names:
        yield f"Do not correct for {'; '.join(names)}. Record that condition again before it is believed."


def _separate(d: TraceDocument) -> Iterator[str]:
    made = d.get("separating_experiment")
    if not made:
        return
    a, b = (sentences.label_of(d, made[key]) for key in ("a", "b"))
    if made["d_expected"] < SEPARATES:
        yield f"“{a}” or “{b}” stays open: no motion of this table tells them apart."
        return
    yield (
        f"To tell “{a}” from “{b}”, record the motion in `experiment.toml` ({duration(made['duration_s'])}; its"
        " text stands at the end of this page), and trace that log together with these."
    )


def _log_more(d: TraceDocument) -> Iterator[str]:
    for entry in d.get("common", []):
        yield (
            f"{_names(entry['channels'])} move together ({entry['label']}), and nothing in the logs says why: record"
            f" {', '.join(entry['record'])} beside the readings."
        )
    open_ = [c for c, status in d.get("status", {}).items() if status in ("unexplained", "partial")]
    if open_:
        yield (
            f"Nothing that was logged explains all of the error of {_names(open_)}. Record a run in which something"
            " else changes (another motion, another temperature), and trace it with these."
        )


def _drift(d: TraceDocument) -> Iterator[str]:
    entries = [e for e in d.get("drift", []) if "common" not in e]
    if not entries:
        return
    channels = list(dict.fromkeys(c for e in entries for c in e["channels"]))
    times = [tau for e in entries if (tau := e.get("tau_s"))]
    often = f" (within {duration(min(times))})" if times else ""
    one = len(channels) == 1
    yield (
        f"{_names(channels)} {'drifts by itself' if one else 'drift by themselves'}: estimate"
        f" {'this bias' if one else 'these biases'} again at rest often enough{often}. The effects file has the filter"
        " expect the drift."
    )


def _second_run(d: TraceDocument) -> Iterator[str]:
    powered = {run.get("power_on", run["id"]) for run in d["runs"]}
    if len(powered) < 2:
        yield (
            "Record the unit once more after it was switched off, and trace both: one power-on does not show whether"
            " these results hold for the next one."
        )


def _names(channels: list[str]) -> str:
    return channels[0] if len(channels) == 1 else f"{', '.join(channels[:-1])} and {channels[-1]}"
