"""How often the tracer is right: blind simulated logs with known truth, counted against what is required.

    python benchmarks/tracing.py [--cases CLASS ...] [--count N] [--seed S] [--json FILE] [--final]
    python benchmarks/tracing.py --replay CLASS:NUMBER [--final]

Every count comes with its 95 % Wilson interval. One line tells of each case that failed; `--replay` shows all that is
found in one. Cases are numbered from `--seed` on; `--final` takes the set that nothing was developed on. All of it is
simulated.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench
import numpy as np
import tracing_cases as cases
from scipy import stats
from tracing_cases import CHANNELS, Case, Truth

from filters.tracing.trace import trace

IN_BAND = 1.2
_NOISE = ("bandwidth", "noise_crosstalk")
_SAME_HZ = 0.02


# ----------------------------------------------------------------------------------------------------------- scoring


@dataclass(frozen=True)
class Told:
    """What a report says of one truth."""

    truth: str
    names: list[str]
    channels: list[str]
    d: float
    detected: bool
    named: bool
    rival: bool  # named, or the truth is among the rivals of what is on its channel
    wrong: bool  # a finding under another name on its channel, and none under its own
    explained: bool  # its channel's status
    e10: float  # after, times the floor, the worst of its channels
    nis: float
    z: list[float]  # of parameters
    transfers: bool


@dataclass(frozen=True)
class Outcome:
    """One case."""

    name: str
    campaign: str
    seconds: float
    told: list[Told]
    findings: list[str]
    elsewhere: list[str]  # findings on channels that nothing is wrong with
    drift: list[str]
    explained_out: list[str]  # channels explained with the held-out run out of its band
    limits: int
    status: dict[str, str] = field(default_factory=dict)
    sentence: str = ""


def scored(case: Case, document: dict[str, Any], seconds: float) -> Outcome:
    """Compare a report with the truth."""
    touched = {c for truth in case.truths for c in truth.channels}
    everything = document["findings"]
    out = [
        c
        for c in CHANNELS
        if document["status"][c] == "explained" and _figure(document, "e10", c) > _limit(document, c)
    ]
    return Outcome(
        case.name,
        case.campaign,
        seconds,
        [told_of(truth, document, case) for truth in case.truths],
        [short(f) for f in everything],
        [short(f) for f in everything if not touched & set(f["channels"])],
        [f"{d['kind']} {','.join(d['channels'])}" for d in document["drift"]],
        out,
        len(document["limits"]),
        document["status"],
        document["sentence"],
    )


def short(finding: dict[str, Any]) -> str:
    """A finding in a few words: effect, channels, score, rivals."""
    rivals = [r["effect"] for r in finding["rivals"]]
    text = f"{finding['effect']} {','.join(finding['channels'])} {finding['score']:.0f}"
    return text + (f" or {'/'.join(rivals)}" if rivals else "")


def told_of(truth: Truth, document: dict[str, Any], case: Case) -> Told:
    """What a report says of one of a case's truths."""
    here = [f for f in document["findings"] if set(f["channels"]) & set(truth.channels)]
    own = [f for f in here if f["effect"] in truth.names and _same_tone(f, truth)]
    named = bool(own) or _elsewhere(truth, document)
    rivals = any(r["effect"] in truth.names for f in here for r in f["rivals"])
    status = {document["status"][c] for c in truth.channels}
    # what does not carry over spoils the held-out run of its channel whatever is found
    lost = {c for other in case.truths if other is not truth and not other.transfers for c in other.channels}
    judged = [c for c in truth.channels if c not in lost]
    flagged = (
        bool(here)
        or any(set(x["channels"]) & set(truth.channels) for x in (*document["drift"], *document["lines"]))
        or any(x["channel"] in truth.channels for x in document["remainder"])
        or "unexplained" in status
    )
    if truth.place in ("integrity", "noise_level"):
        flagged = any(set(x["channels"]) & set(truth.channels) for x in document[truth.place])
    return Told(
        truth.text,
        sorted(truth.names),
        list(truth.channels),
        truth.d,
        flagged or named,
        named,
        named or rivals,
        bool([f for f in here if f["effect"] not in _NOISE]) and not named,
        "explained" in status,
        max((_figure(document, "e10", c) for c in judged), default=np.nan),
        max((_figure(document, "nis", c) for c in judged), default=np.nan),
        _z(truth, own),
        truth.transfers,
    )


def _elsewhere(truth: Truth, document: dict[str, Any]) -> bool:
    """Whether one of the lists beside the findings has it."""
    where = set(truth.channels)
    if truth.hz > 0.0:
        for line in document["lines"]:
            hz = [line["hz"] * n for n in line["harmonics"]]
            if where & set(line["channels"]) and min(abs(f / truth.hz - 1.0) for f in hz) < _SAME_HZ:
                return True
        return False
    match truth.place:
        case "drift":
            return any(where & set(x["channels"]) and x["kind"] in truth.names for x in document["drift"])
        case "integrity":
            return any(where & set(x["channels"]) and x["effect"] in truth.names for x in document["integrity"])
        case "noise_level":
            return any(where & set(x["channels"]) and x["driver"] in truth.names for x in document["noise_level"])
    return False


def _same_tone(finding: dict[str, Any], truth: Truth) -> bool:
    if truth.hz <= 0.0:
        return True
    return abs(float(finding["shape"].get("hz", 0.0)) / truth.hz - 1.0) < _SAME_HZ


def _z(truth: Truth, own: list[dict[str, Any]]) -> list[float]:
    """Errors of parameters over their standard deviations."""
    if not own:
        return []
    found = {p["name"]: p for p in own[0]["params"]}
    return [
        float((found[name]["value"] - value) / found[name]["sd"])
        for name, value in truth.parameters.items()
        if name in found and found[name]["sd"]
    ]


def _figure(document: dict[str, Any], metric: str, channel: str) -> float:
    """A figure after, over its floor."""
    return max(
        (x["after_x_floor"] for x in document["error"] if x["metric"] == metric and x["channel"] == channel),
        default=float("nan"),
    )


def _limit(document: dict[str, Any], channel: str) -> float:
    for x in document["error"]:
        if x["metric"] == "e10" and x["channel"] == channel:
            return max(IN_BAND, float(x["floor_band95"][1] / x["floor"]))
    return float("inf")


# ---------------------------------------------------------------------------------------------------------- the table


@dataclass(frozen=True)
class Row:
    """A count of the table: what, how many of how many, and what is required."""

    kind: str
    text: str
    count: int
    of: int
    required: str
    met: bool | None

    def line(self) -> str:
        """For a terminal."""
        low, high = wilson(self.count, self.of)
        verdict = {True: "met", False: "MISSED", None: ""}[self.met]
        share = f"{self.count:4d} of {self.of:3d}   {low:.2f}..{high:.2f}"
        return f"{self.kind:10s} {self.text:62s} {share}   {self.required:14s} {verdict}"


def wilson(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share."""
    if of == 0:
        return 0.0, 1.0
    interval = stats.binomtest(count, of).proportion_ci(0.95, "wilson")
    return float(interval.low), float(interval.high)


def _most(kind: str, text: str, flags: Iterable[bool], most: int, of: int) -> Row:
    """At most so many of so many, in proportion."""
    own = list(flags)
    return Row(kind, text, sum(own), len(own), f"<= {most} of {of}", sum(own) <= most * len(own) / of)


def _least(kind: str, text: str, flags: Iterable[bool], share: float, required: str = "") -> Row:
    own = list(flags)
    return Row(kind, text, sum(own), len(own), required or f">= {100 * share:.0f} %", sum(own) >= share * len(own))


def _plain(kind: str, text: str, flags: Iterable[bool]) -> Row:
    own = list(flags)
    return Row(kind, text, sum(own), len(own), "", None)


def table(outcomes: dict[str, list[Outcome]]) -> list[Row]:
    """All counts that the cases allow."""
    rows: list[Row] = []
    for kind, own in outcomes.items():
        told = [t for o in own for t in o.told]
        rows += _ROWS[kind](kind, own, told)
    transfers = [
        t
        for kind in ("catalogue", "several")
        for o in outcomes.get(kind, [])
        for t in o.told
        if t.transfers and t.d >= 10
    ]
    if transfers:
        judged = [t for t in transfers if np.isfinite(t.nis)]
        rows.append(
            _least("transfer", "√NIS after <= 1.20 on the held-out run", (t.nis <= IN_BAND for t in judged), 0.9)
        )
        rows.append(_plain("transfer", "E10 after <= 1.20 x floor", (t.e10 <= IN_BAND for t in judged)))
        z = [abs(x) for t in transfers if t.named for x in t.z]
        inside = sum(x <= 2.0 for x in z)
        met = 0.88 * len(z) <= inside if z else None
        rows.append(Row("transfer", f"parameters within 2 sd (rms z {_rms(z):.2f})", inside, len(z), "88..100 %", met))
    everywhere = [o for kind in ("catalogue", "faint", "several", "form", "single") for o in outcomes.get(kind, [])]
    if everywhere:
        rows.append(_plain("all", "a finding on an untouched channel", (bool(o.elsewhere) for o in everywhere)))
    return rows


def _rms(z: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(z)))) if z else float("nan")


def _free(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _most(kind, "a finding", (bool(o.findings) for o in own), 2, 40),
        _plain(kind, "drift", (bool(o.drift) for o in own)),
    ]


def _flicker(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    deterministic = ([f for f in o.findings if f.split()[0] not in _NOISE] for o in own)
    channels = [c for o in own for c in CHANNELS]
    drifting = {o.name: " ".join(o.drift) for o in own}
    return [
        _most(kind, "a deterministic finding", (bool(f) for f in deterministic), 3, 30),
        _plain(kind, "channels with drift", (c in drifting[o.name] for o in own for c in channels[:6])),
    ]


def _catalogue(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _least(kind, "detected on the right channel", (t.detected for t in told), 53 / 60, ">= 53 of 60"),
        _plain(kind, "named", (t.named for t in told)),
        _least(kind, "named, or the truth is a rival", (t.rival for t in told), 48 / 60, ">= 48 of 60"),
        _most(kind, "a wrong name, explained", (t.wrong and t.explained for t in told), 3, 60),
        _plain(kind, "d > 15 detected", (t.detected for t in told if t.d > 15)),
        _plain(kind, "d > 15 named", (t.named for t in told if t.d > 15)),
    ]


def _faint(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _most(kind, "a wrong name", (t.wrong and not t.rival for t in told), 0, 20),
        _plain(kind, "detected", (t.detected for t in told)),
        _least(kind, "the limit is told, or it is named", (o.limits > 0 or o.told[0].rival for o in own), 1.0),
    ]


def _several(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _plain(kind, "detected on the right channel", (t.detected for t in told)),
        _plain(kind, "named", (t.named for t in told)),
        _plain(kind, "named, or the truth is a rival", (t.rival for t in told)),
        _plain(kind, "a wrong name, explained", (t.wrong and t.explained for t in told)),
    ]


def _form(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    wrong = [t for t in told if t.wrong and t.explained]
    return [
        _least(kind, "detected on the right channel", (t.detected for t in told), 0.9),
        _least(kind, "right driver", (t.named for t in told), 0.8),
        _plain(kind, "right driver, or among the rivals", (t.rival for t in told)),
        _most(kind, "a wrong name, explained", (t.wrong and t.explained for t in told), 5, 30),
        _most(kind, "  with the held-out run above 1.20 x floor", (t.e10 > IN_BAND for t in wrong), 0, 30),
    ]


def _unknown(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _least(kind, "flagged on the right channel", (t.detected for t in told), 0.9),
        _most(kind, "explained with the held-out run out of band", (bool(o.explained_out) for o in own), 0, 20),
        _plain(kind, "explained", (t.explained for t in told)),
        _plain(kind, "a deterministic finding there", (t.wrong for t in told)),
    ]


def _integrity(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [_least(kind, "found", (t.named for t in told), 0.95)]


def _noise(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [_least(kind, "detected", (t.detected for t in told), 0.9), _plain(kind, "named", (t.named for t in told))]


def _single(kind: str, own: list[Outcome], told: list[Told]) -> list[Row]:
    return [
        _least(kind, "the truth is the name or a rival", (t.rival for t in told), 0.8),
        _plain(kind, "named", (t.named for t in told)),
        _plain(kind, "detected", (t.detected for t in told)),
        _most(kind, "explained", (t.explained for t in told), 0, 20),
    ]


_ROWS: dict[str, Callable[[str, list[Outcome], list[Told]], list[Row]]] = {
    "free": _free,
    "flicker": _flicker,
    "catalogue": _catalogue,
    "faint": _faint,
    "several": _several,
    "form": _form,
    "unknown": _unknown,
    "integrity": _integrity,
    "noise": _noise,
    "single": _single,
}


def failed(kind: str, outcome: Outcome) -> str:
    """What is not as it should be, in a few words; empty if all is."""
    deterministic = [f for f in outcome.findings if f.split()[0] not in _NOISE]
    if kind in ("free", "flicker"):
        return "found what is not there" if (outcome.findings if kind == "free" else deterministic) else ""
    words = []
    for t in outcome.told:
        if kind == "faint":
            words += ["wrong name"] if t.wrong and not t.rival else []
        elif kind == "unknown" or kind == "noise":
            words += [] if t.detected else ["missed"]
        elif not t.detected:
            words.append(f"missed {t.names[0]}")
        elif not t.rival:
            words.append(f"not named {t.names[0]}" + (", EXPLAINED" if t.wrong and t.explained else ""))
        elif not t.named and kind != "single":
            words.append(f"only a rival {t.names[0]}")
        if kind in ("catalogue", "several") and t.transfers and t.d >= 10 and t.nis > IN_BAND:
            words.append(f"√NIS {t.nis:.2f}")
    words += [f"{c} explained out of band" for c in outcome.explained_out]
    words += [f"elsewhere: {f}" for f in outcome.elsewhere if kind not in ("integrity", "noise", "unknown")]
    return "; ".join(words)


# --------------------------------------------------------------------------------------------------------- running it


def run(name: str, final: bool) -> tuple[Case, dict[str, Any], float]:
    """Make a case and trace it: the case, the report, CPU seconds of the tracing."""
    kind, number = name.split(":")
    case = cases.case(kind, int(number), final)
    asked = sorted({n for truth in case.truths for n in truth.names}) if kind == "faint" else []
    start = time.process_time()
    document = {**trace(case.runs, case.heldout, asked=asked).document}
    return case, document, time.process_time() - start


def shown(name: str, case: Case, document: dict[str, Any], seconds: float) -> None:
    """Print all that is found in one case."""
    print(
        f"{name}: {case.campaign}, {len(case.runs)} runs of {case.runs[0].seconds:.0f} s, traced in {seconds:.1f} s CPU"
    )
    for truth in case.truths:
        print(f"  true    {truth.text} on {','.join(truth.channels)}, d {truth.d:.1f}")
    print(f"  says    {document['sentence']}")
    for f in document["findings"]:
        params = ", ".join(
            f"{p['name']} {p['value']:.4g}" + (f" ± {p['sd']:.2g}" if p["sd"] else "") + f" {p['unit']}"
            for p in f["params"][:4]
        )
        print(f"  found   {f['effect']} {f['channels']} {f['shape']} {params}")
        held = "" if f["heldout_gain"] is None else f", unseen cells {f['heldout_gain']:.0f}"
        share = "" if f["share_of_excess"] is None else f", share {f['share_of_excess']:.2f}"
        print(f"            score {f['score']:.1f}, gain {f['gain']:.1f}{held}{share}, confirmed {f['confirmed']}")
        for r in f["rivals"]:
            print(f"            or {r['effect']} ({r['score_difference']:+.1f})")
    for key in ("weak", "drift", "lines", "noise_level", "integrity", "remainder", "limits"):
        for entry in document[key]:
            print(f"  {key:7s} {entry}")
    print(f"  status  {document['status']}")
    for x in document["error"]:
        if x["metric"] in ("e10", "nis"):
            band = x["floor_band95"][1] / x["floor"]
            print(
                f"  {x['metric']:7s} {x['channel']} {x['before_x_floor']:.2f} -> {x['after_x_floor']:.2f} x floor"
                f" (band to {band:.2f})"
            )


def main() -> None:
    """Count."""
    arguments = bench.options(__doc__, cases=cases.CLASSES, count=int, seed=0, json=Path, final=False, replay=str)
    if arguments.replay:
        shown(arguments.replay, *run(arguments.replay, arguments.final))
        return
    outcomes: dict[str, list[Outcome]] = {}
    for kind in arguments.cases:
        count = arguments.count or cases.CLASSES[kind][1]
        for number in range(arguments.seed, arguments.seed + count):
            name = f"{kind}:{number}"
            case, document, seconds = run(name, arguments.final)
            outcome = scored(case, document, seconds)
            outcomes.setdefault(kind, []).append(outcome)
            words = failed(kind, outcome)
            truth = "; ".join(f"{t.truth} on {','.join(t.channels)} d {t.d:.1f}" for t in outcome.told)
            if words:
                found = " | ".join([*outcome.findings, *outcome.drift])
                print(f"{name} {case.campaign}: {words}\n    true: {truth}\n    says: {found}", flush=True)
            print(f"{name} {seconds:.1f} s {'FAILED' if words else 'well'}", file=sys.stderr, flush=True)
    if arguments.json:
        document = {kind: [asdict(o) for o in own] for kind, own in outcomes.items()}
        arguments.json.write_text(json.dumps(document, indent=1))
    print()
    print(bench.describe("numpy", "scipy", "numba"))
    print(f"\n{'set for the last count' if arguments.final else 'development set'}, simulated, 95 % Wilson intervals\n")
    for row in table(outcomes):
        print(row.line())
    spent = [o.seconds for own in outcomes.values() for o in own]
    print(f"\nCPU time of a trace: {bench.told(spent)} s")


if __name__ == "__main__":
    main()
