"""How often the tracer is right: blind logs with known truth, counted against what is required.

    python benchmarks/tracing.py [--cases CLASS ...] [--count N] [--first N] [--json FILE] [--final]
    python benchmarks/tracing.py --replay CLASS:NUMBER [--final]

Every count comes with its 95 % Wilson interval. One line tells of each case that failed; `--replay` shows all that is
found in one. Cases are numbered from `--first` on; `--final` takes the set that nothing was developed on.

Without `--cases` all of it is simulated. The classes unspoiled, slow, fast and other are on measured noise (ADIS16405,
2 h 46 min at 100 Hz; MPU-6050, 11 min with host stamps), cut into runs, to which effects, temperatures and the table's
motion are added; they need the recordings (`../shared/data`).
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench
import numpy as np
import tracing_cases as simulated
import tracing_real_cases as measured
from tracing_cases import CHANNELS, Case
from tracing_score import IN_BAND, Outcome, Told, scored

from filters.tracing.trace import trace

STRONG_D = 60.0


# ---------------------------------------------------------------------------------------------------------- the table

Outcomes = list[Outcome]
Flags = Callable[[Outcomes], list[bool]]
Bound = Callable[[int, int], tuple[str, bool]]  # from a count of so many, to what is required and whether it is met


@dataclass(frozen=True)
class Row:
    """A count of the table: what, how many of how many, and what is required."""

    kind: str
    text: str
    count: int
    of: int
    required: str = ""
    met: bool | None = None

    def line(self) -> str:
        """For a terminal."""
        low, high = bench.wilson(self.count, self.of)
        verdict = {True: "met", False: "MISSED", None: ""}[self.met]
        share = f"{self.count:4d} of {self.of:3d}   {low:.2f}..{high:.2f}"
        return f"{self.kind:10s} {self.text:62s} {share}   {self.required:14s} {verdict}"


def most(count: int, of: int) -> Bound:
    """At most so many of so many, in proportion."""
    return lambda found, n: (f"<= {count} of {of}", found <= count * n / of)


def least(share: float, of: int = 0) -> Bound:
    """At least such a share."""
    words = f">= {share * of:.0f} of {of}" if of else f">= {100 * share:.0f} %"
    return lambda found, n: (words, found >= share * n)


def counted(kind: str, text: str, flags: Iterable[bool], bound: Bound | None) -> Row:
    """A row of flags."""
    own = list(flags)
    if bound is None:
        return Row(kind, text, sum(own), len(own))
    return Row(kind, text, sum(own), len(own), *bound(sum(own), len(own)))


def cases(flag: Callable[[Outcome], object]) -> Flags:
    """Of each case."""
    return lambda own: [bool(flag(o)) for o in own]


def truths(flag: Callable[[Told], bool], of: Callable[[Told], bool] = lambda t: True) -> Flags:
    """Of each truth, or of some."""
    return lambda own: [flag(t) for o in own for t in o.told if of(t)]


def untouched(findings: Callable[[Outcome], list[str]]) -> Flags:
    """Of each channel that nothing was added to: whether something is found on it."""

    def flags(own: Outcomes) -> list[bool]:
        counts = [(len({c for f in findings(o) for c in f.split()[1].split(",")}), o.untouched) for o in own]
        return [k < count for count, of in counts for k in range(of)]

    return flags


def wrong_and_explained(told: Told) -> bool:
    """Whether a channel is explained under another name."""
    return told.wrong and told.explained


def detected(told: Told) -> bool:
    """Whether a truth is seen on its channel."""
    return told.detected


def named(told: Told) -> bool:
    """Whether it has its name."""
    return told.named


def rival(told: Told) -> bool:
    """Whether it has its name, or its name is a rival."""
    return told.rival


def _of_size(d: float, aim: float | None, *, at_least: bool = False) -> list[tuple[str, Flags, Bound | None]]:
    """Rows of the effects of a size, or at least of it."""
    words = f"d {'>= ' * at_least}{d:.0f}: "
    flags: dict[str, tuple[Callable[[Told], bool], Bound | None]] = {
        "something found on its channel": (lambda t: t.found, None),
        "named": (named, None),
        "named, or the truth is a rival": (rival, least(aim) if aim else None),
        "at least listed as weak by its name": (lambda t: t.weak, None),
        "at least something listed there": (lambda t: t.listed, least(1.0) if aim else None),
    }
    of = (lambda t: t.d >= d) if at_least else (lambda t: t.d == d)
    return [(words + text, truths(flag, of), bound) for text, (flag, bound) in flags.items()]


def _on_measured_noise(aim: float | None) -> list[tuple[str, Flags, Bound | None]]:
    wrong = truths(lambda t: wrong_and_explained(t) and not t.rival)
    elsewhere = untouched(lambda o: o.false)
    return [
        *(row for d in measured.SIZES for row in _of_size(d, None)),
        *_of_size(STRONG_D, aim, at_least=True),
        ("its channel explained under another name", wrong, most(0, 1)),
        ("untouched channels with a finding, tones and shared steps apart", elsewhere, None),
    ]


ROWS: dict[str, list[tuple[str, Flags, Bound | None]]] = {
    "free": [("a finding", cases(lambda o: o.findings), most(2, 40)), ("drift", cases(lambda o: o.drift), None)],
    "flicker": [
        ("a deterministic finding", cases(lambda o: o.deterministic), most(3, 30)),
        ("channels with drift", lambda own: [c in " ".join(o.drift) for o in own for c in CHANNELS], None),
    ],
    "catalogue": [
        ("detected on the right channel", truths(detected), least(53 / 60, 60)),
        ("named", truths(named), None),
        ("named, or the truth is a rival", truths(rival), least(48 / 60, 60)),
        ("a wrong name, explained", truths(wrong_and_explained), most(3, 60)),
        ("d > 15 detected", truths(detected, lambda t: t.d > 15), None),
        ("d > 15 named", truths(named, lambda t: t.d > 15), None),
    ],
    "faint": [
        ("a wrong name", truths(lambda t: t.wrong and not t.rival), most(0, 20)),
        ("detected", truths(detected), None),
        ("the limit is told, or it is named", cases(lambda o: o.limits > 0 or o.told[0].rival), least(1.0)),
    ],
    "several": [
        ("detected on the right channel", truths(detected), None),
        ("named", truths(named), None),
        ("named, or the truth is a rival", truths(rival), None),
        ("a wrong name, explained", truths(wrong_and_explained), None),
    ],
    "form": [
        ("detected on the right channel", truths(detected), least(0.9)),
        ("right driver", truths(named), least(0.8)),
        ("right driver, or among the rivals", truths(rival), None),
        ("a wrong name, explained", truths(wrong_and_explained), most(5, 30)),
        (
            "  with the held-out run above 1.20 x floor",
            truths(lambda t: t.e10 > IN_BAND, wrong_and_explained),
            most(0, 30),
        ),
    ],
    "unknown": [
        ("flagged on the right channel", truths(detected), least(0.9)),
        ("explained with the held-out run out of band", cases(lambda o: o.explained_out), most(0, 20)),
        ("explained", truths(lambda t: t.explained), None),
        ("a deterministic finding there", truths(lambda t: t.wrong), None),
    ],
    "integrity": [("found", truths(named), least(0.95))],
    "noise": [("detected", truths(detected), least(0.9)), ("named", truths(named), None)],
    "single": [
        ("the truth is the name or a rival", truths(rival), least(0.8)),
        ("named", truths(named), None),
        ("detected", truths(detected), None),
        ("explained", truths(lambda t: t.explained), most(0, 20)),
    ],
    "unspoiled": [
        (
            "channels with a deterministic finding, tones and shared steps apart",
            untouched(lambda o: o.false),
            lambda found, n: ("<= 2 %", found <= 0.02 * n),
        ),
        ("channels with a step that another has too", untouched(lambda o: o.shared), None),
        ("channels with a tone", untouched(lambda o: o.tones), None),
    ],
    "slow": _on_measured_noise(0.6),
    "fast": _on_measured_noise(0.95),
    "other": _on_measured_noise(None),
}


def table(outcomes: dict[str, Outcomes]) -> list[Row]:
    """All counts that the cases allow."""
    rows = [
        row
        for kind, own in outcomes.items()
        for text, flags, bound in ROWS[kind]
        if (row := counted(kind, text, flags(own), bound)).of or kind in simulated.CLASSES
    ]
    told = [t for kind in ("catalogue", "several") for o in outcomes.get(kind, []) for t in o.told]
    transfers = [t for t in told if t.transfers and t.d >= 10]
    if transfers:
        nis = [t.nis <= IN_BAND for t in transfers if np.isfinite(t.nis)]
        rows.append(counted("transfer", "√NIS after <= 1.20 on the held-out run", nis, least(0.9)))
        rows.append(counted("transfer", "E10 after <= 1.20 x floor", (t.e10 <= IN_BAND for t in transfers), None))
        z = [abs(x) for t in transfers if t.named for x in t.z]
        inside = sum(x <= 2.0 for x in z)
        met = 0.88 * len(z) <= inside if z else None
        rms = float(np.sqrt(np.mean(np.square(z)))) if z else float("nan")
        rows.append(Row("transfer", f"parameters within 2 sd (rms z {rms:.2f})", inside, len(z), "88..100 %", met))
    everywhere = [o for kind in ("catalogue", "faint", "several", "form", "single") for o in outcomes.get(kind, [])]
    if everywhere:
        flags = cases(lambda o: o.elsewhere)(everywhere)
        rows.append(counted("all", "a finding on an untouched channel", flags, None))
    return rows


def failed(kind: str, outcome: Outcome) -> str:
    """What is not as it should be, in a few words; empty if all is."""
    if kind in ("free", "flicker", "unspoiled"):
        found = {"free": outcome.findings, "flicker": outcome.deterministic, "unspoiled": outcome.false}[kind]
        return "found what is not there" if found else ""
    words = []
    for t in outcome.told:
        if kind == "faint":
            words += ["wrong name"] if t.wrong and not t.rival else []
        elif kind in ("unknown", "noise"):
            words += [] if t.detected else ["missed"]
        elif not (t.weak if kind in measured.CLASSES else t.detected):
            words.append(f"missed {'/'.join(t.names[:1])}")
        elif not t.rival:
            words.append(f"not named {t.names[0]}" + (", EXPLAINED" if wrong_and_explained(t) else ""))
        elif not t.named and kind != "single":
            words.append(f"only a rival {t.names[0]}")
        if kind in ("catalogue", "several") and t.transfers and t.d >= 10 and t.nis > IN_BAND:
            words.append(f"√NIS {t.nis:.2f}")
    if kind not in measured.CLASSES:
        words += [f"{c} explained out of band" for c in outcome.explained_out]
    elsewhere = outcome.false if kind in measured.CLASSES else outcome.elsewhere
    words += [f"elsewhere: {f}" for f in elsewhere if kind not in ("integrity", "noise", "unknown")]
    return "; ".join(words)


# --------------------------------------------------------------------------------------------------------- running it


def run(name: str, final: bool) -> tuple[Case, dict[str, Any], float]:
    """Make a case and trace it: the case, the report, CPU seconds of the tracing."""
    kind, number = name.split(":")
    case = (measured if kind in measured.CLASSES else simulated).case(kind, int(number), final)
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
    defaults = {"cases": list(simulated.CLASSES), "count": int, "first": 0, "json": Path, "final": False, "replay": str}
    asked = bench.options(__doc__, **defaults)
    if asked.replay:
        shown(asked.replay, *run(asked.replay, asked.final))
        return
    on_measured = [kind for kind in asked.cases if kind in measured.CLASSES]
    if on_measured and (why := measured.missing()):
        print(f"skipped: {why}")
        return
    outcomes: dict[str, Outcomes] = {}
    for kind in asked.cases:
        for number in range(
            asked.first, asked.first + (asked.count or (simulated.CLASSES | measured.CLASSES)[kind][1])
        ):
            name = f"{kind}:{number}"
            case, document, seconds = run(name, asked.final)
            outcome = scored(case, document, seconds)
            outcomes.setdefault(kind, []).append(outcome)
            words = failed(kind, outcome)
            if words:
                truth = "; ".join(f"{t.truth} on {','.join(t.channels)} d {t.d:.1f}" for t in outcome.told)
                found = " | ".join([*outcome.findings, *outcome.drift, *(f"weak {w}" for w in outcome.weak)])
                print(f"{name} {case.campaign}: {words}\n    true: {truth}\n    says: {found}", flush=True)
            print(f"{name} {seconds:.1f} s {'FAILED' if words else 'well'}", file=sys.stderr, flush=True)
    if asked.json:
        asked.json.write_text(json.dumps({kind: [asdict(o) for o in own] for kind, own in outcomes.items()}, indent=1))
    print(f"\n{bench.describe('numpy', 'scipy', 'numba')}")
    how = f"simulated, but for measured noise of {', '.join(on_measured)}" if on_measured else "simulated"
    print(f"\n{'set for the last count' if asked.final else 'development set'}, {how}; 95 % Wilson intervals\n")
    for row in table(outcomes):
        print(row.line())
    print(f"\nCPU time of a trace: {bench.told([o.seconds for own in outcomes.values() for o in own])} s")


if __name__ == "__main__":
    main()
