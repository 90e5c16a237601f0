"""How often the tracer is right on measured noise: effects of known size added to recordings of units at rest.

    python benchmarks/tracing_real.py [--cases CLASS ...] [--count N] [--first N] [--json FILE] [--final]
    python benchmarks/tracing_real.py --replay CLASS:NUMBER [--final]

The noise is measured (ADIS16405, 2 h 46 min at 100 Hz; MPU-6050, 11 min with host stamps), cut into runs; effects,
temperatures and the table's motion are simulated and added to it. Every count comes with its 95 % Wilson interval.
Cases are numbered from `--first` on; `--final` takes seeds, and the half of the long recording, that nothing was
developed on. Without the recordings (`../shared/data`) it says so and ends.
"""

import json
import os
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench
import tracing
import tracing_real_cases as cases
from tracing import Row
from tracing_cases import CHANNELS, Case

from filters.tracing.trace import trace

_NOISE = ("bandwidth", "noise_crosstalk")
_STRONG = 60.0
_SAME_S = 4.0


@dataclass(frozen=True)
class Outcome:
    """What a report says of one case."""

    name: str
    campaign: str
    seconds: float  # CPU time of the trace
    # truth, names, channels, d: of the effect; empty and 0 without one
    truth: str
    names: list[str]
    channels: list[str]
    d: float
    # found, named, rival: whether something deterministic is found on its channel, its name is there, or at least among
    # the rivals
    found: bool
    named: bool
    rival: bool
    weak: bool  # whether its name is at least in the list of what is too weak, with size and limit
    listed: bool  # whether anything on its channel is found or in that list
    wrong: bool  # whether its channel is explained under another name
    false: list[str]  # deterministic findings, but tones and shared steps, on channels that nothing was added to
    # steps there that another channel has at the same time: something happened to the unit in the recording
    shared: list[str]
    tones: list[str]  # tones there: vibration of the site is in the recordings
    untouched: int  # number of those channels
    # findings, drift, status: as told
    findings: list[str]
    weaks: list[str]
    drift: list[str]
    status: dict[str, str]


def scored(case: Case, document: dict[str, Any], seconds: float) -> Outcome:
    """Compare a report with the truth."""
    touched = {c for truth in case.truths for c in truth.channels}
    findings = [f for f in document["findings"] if f["effect"] not in _NOISE]
    elsewhere = [f for f in findings if not touched & set(f["channels"])]
    shared = [f for f in elsewhere if _is_shared(f, findings)]
    elsewhere = [f for f in elsewhere if f not in shared]
    told = [tracing.told_of(truth, document, case) for truth in case.truths]
    here = [f for f in findings if touched & set(f["channels"])]
    weak = [w for w in document["weak"] if touched & set(w["channels"])]
    names = {n for truth in case.truths for n in truth.names}
    rival = bool(told) and all(t.rival for t in told)
    named = bool(told) and all(t.named for t in told)
    return Outcome(
        name=case.name,
        campaign=case.campaign,
        seconds=seconds,
        truth="; ".join(truth.text for truth in case.truths),
        names=sorted(names),
        channels=sorted(touched),
        d=max((truth.d for truth in case.truths), default=0.0),
        found=bool(here) or named,
        named=named,
        rival=rival,
        weak=rival or any(w["effect"] in names for w in weak),
        listed=bool(here) or bool(weak) or named,
        wrong=any(t.wrong and t.explained and not t.rival for t in told),
        false=[tracing.short(f) for f in elsewhere if f["effect"] != "tone"],
        shared=[tracing.short(f) for f in shared],
        tones=[tracing.short(f) for f in elsewhere if f["effect"] == "tone"],
        untouched=len(CHANNELS) - len(touched),
        findings=[tracing.short(f) for f in findings],
        weaks=[
            f"{w['effect']} {','.join(w['channels'])} {w['score']:.0f}/{w['guarded_score']:.0f}"
            for w in document["weak"]
        ],
        drift=[f"{x['kind']} {','.join(x['channels'])}" for x in document["drift"]],
        status=document["status"],
    )


def _short_weak(weak: dict[str, Any]) -> str:
    return f"{weak['effect']} {','.join(weak['channels'])} {weak['score']:.0f}/{weak['guarded_score']:.0f}"


def _is_shared(finding: dict[str, Any], findings: list[dict[str, Any]]) -> bool:
    """Whether a step is one of several channels: told as common, or another channel steps at the same time."""
    if finding["effect"] != "step":
        return False
    if finding.get("common") is not None:
        return True
    own = finding["shape"]
    return any(
        f["effect"] == "step"
        and f["channels"] != finding["channels"]
        and f["shape"]["run"] == own["run"]
        and abs(f["shape"]["at_s"] - own["at_s"]) < _SAME_S
        for f in findings
    )


# --------------------------------------------------------------------------------------------------------- the table


def _row(kind: str, text: str, flags: Iterable[bool], least: float | None = None, most: float | None = None) -> Row:
    own = list(flags)
    return _counted(kind, text, sum(own), len(own), least, most)


def _counted(kind: str, text: str, count: int, of: int, least: float | None, most: float | None) -> Row:
    required, met = "", None
    if least is not None:
        required, met = f">= {100 * least:.0f} %", count >= least * of
    if most is not None:
        required, met = f"<= {100 * most:.0f} %", count <= most * of
    return Row(kind, text, count, of, required, met if of else None)


_AIMS = {"slow": 0.6, "fast": 0.95}


def table(outcomes: list[Outcome]) -> list[Row]:
    """All counts that the outcomes allow."""
    rows = []
    for kind in cases.CLASSES:
        own = [o for o in outcomes if o.name.split(":")[0] == kind]
        if not own:
            continue
        if kind == "unspoiled":
            count, of = sum(_channels(o.false) for o in own), sum(o.untouched for o in own)
            rows.append(
                _counted(
                    kind, "channels with a deterministic finding, tones and shared steps apart", count, of, None, 0.02
                )
            )
            count = sum(_channels(o.shared) for o in own)
            rows.append(_counted(kind, "channels with a step that another has too", count, of, None, None))
            rows.append(_counted(kind, "channels with a tone", sum(_channels(o.tones) for o in own), of, None, None))
            continue
        for d in cases.SIZES:
            rows += _of_size(kind, f"d {d:.0f}", [o for o in own if o.d == d], None)
        rows += _of_size(kind, f"d >= {_STRONG:.0f}", [o for o in own if o.d >= _STRONG], _AIMS.get(kind))
        rows.append(_row(kind, "its channel explained under another name", (o.wrong for o in own), None, 0.0))
        count, of = sum(_channels(o.false) for o in own), sum(o.untouched for o in own)
        rows.append(
            _counted(kind, "untouched channels with a finding, tones and shared steps apart", count, of, None, None)
        )
    return rows


def _of_size(kind: str, size: str, own: list[Outcome], aim: float | None) -> list[Row]:
    if not own:
        return []
    return [
        _row(kind, f"{size}: something found on its channel", (o.found for o in own)),
        _row(kind, f"{size}: named", (o.named for o in own)),
        _row(kind, f"{size}: named, or the truth is a rival", (o.rival for o in own), aim),
        _row(kind, f"{size}: at least listed as weak by its name", (o.weak for o in own)),
        _row(kind, f"{size}: at least something listed there", (o.listed for o in own), None if aim is None else 1.0),
    ]


def _channels(findings: list[str]) -> int:
    """Number of channels that findings are on."""
    return len({c for f in findings for c in f.split()[1].split(",")})


# ------------------------------------------------------------------------------------------------------- running it


def run(name: str, final: bool) -> tuple[Case, dict[str, Any], float]:
    """Make a case and trace it: the case, the report, CPU seconds of the tracing."""
    kind, number = name.split(":")
    case = cases.case(kind, int(number), final)
    start = time.process_time()
    document: dict[str, Any] = dict(trace(case.runs, case.heldout).document)
    return case, document, time.process_time() - start


def told(outcome: Outcome) -> str:
    """A line on one case."""
    grade = "named" if outcome.named else "rival" if outcome.rival else "weak" if outcome.weak else "MISSED"
    grade = "" if not outcome.names and not outcome.truth else grade
    words = f"{outcome.name} {outcome.campaign} {outcome.seconds:.1f} s"
    if outcome.truth:
        words += f": {grade}, d {outcome.d:.0f} {outcome.truth} on {','.join(outcome.channels)}"
    words += f"\n    found: {' | '.join(outcome.findings) or '-'}; weak: {' | '.join(outcome.weaks) or '-'}"
    return (
        words
        + (f"\n    FALSE: {' | '.join(outcome.false)}" if outcome.false else "")
        + ("\n    EXPLAINED WRONGLY" if outcome.wrong else "")
    )


def main() -> None:
    """Count."""
    arguments = bench.options(__doc__, cases=cases.CLASSES, count=int, first=0, json=Path, final=False, replay=str)
    if why := cases.missing():
        print(f"skipped: {why}")
        return
    if arguments.replay:
        tracing.shown(arguments.replay, *run(arguments.replay, arguments.final))
        return
    outcomes = []
    for kind in arguments.cases:
        count = arguments.count or cases.CLASSES[kind][1]
        for number in range(arguments.first, arguments.first + count):
            outcomes.append(scored(*run(f"{kind}:{number}", arguments.final)))
            print(told(outcomes[-1]), file=sys.stderr, flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(o) for o in outcomes], indent=1))
    print(bench.describe("numpy", "scipy", "numba"))
    which = "set for the last count" if arguments.final else "development set"
    print(f"\n{which}: measured noise; simulated effects, temperatures and motion; 95 % Wilson intervals\n")
    for row in table(outcomes):
        print(row.line())
    print(f"\nCPU time of a trace: {bench.told([o.seconds for o in outcomes])} s")


if __name__ == "__main__":
    main()
