"""An investigation: a table takes a unit through the motions that tell most, until what is wrong with it is explained.

    start      motions that let every effect of the catalogue be told
    rounds     trace all runs so far, plan what tells most for its time, make it, again
    held out   a last run with motions of its own judges; where it does not find all explained and time is left, it
               joins the others, and the rounds go on

The diary (`investigation_diary`) is all that is needed to go on after any stop: a motion that was cut is made again.
What it leaves out: how a motion is made and recorded (`Laboratory`), what is expected of it (`planning` of
`filters.tracing`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast

from filters.channels import CHANNELS
from filters.effects import plain_names
from filters.errors import InputError
from imutui.jobs.investigation_diary import NOTHING, Diary, Kind, Outcome, RivalsEntry, RoundEntry

if TYPE_CHECKING:
    from filters.tracing.assessment import Assessment
    from filters.tracing.candidate_motions import CandidateMotion
    from filters.tracing.planning import Dispute, Expectation, Planner
    from filters.tracing.run import Run
    from filters.tracing.table_motions import Table
    from filters.tracing.trace_document import TraceFindings

OVERHEAD_S = 15.0  # that come to each motion: the way there, begin and end of the recording
_SHARE = 0.25  # of the time so far that motions take which are planned together, for a trace takes time too
_TOGETHER_S = 240.0  # of these, at least
_UNDECIDED = 0.5  # bits that disputes may hold on a unit whose channels are all explained
_MOST_ODDS = 20  # entries of odds that a round keeps
_MOST_MOVED = 3  # odds that are told of a round


class Laboratory(Protocol):
    """A unit on a table, and where its runs are."""

    table: "Table"

    def now_s(self) -> float:
        """Time since this session began, s of the unit's."""

    def record(self, motion: "CandidateMotion", number: int) -> str:
        """Make a motion and record it; returns the log's name once that is whole. Whatever stops it is raised."""

    def runs(self, rounds: Sequence[RoundEntry]) -> "list[Run]":
        """Runs of rounds that were made."""

    def judged(self, rounds: Sequence[RoundEntry]) -> "TraceFindings":
        """Trace of the rounds, the last one held out; what is to be kept of it is written."""


Tell = Callable[[str, RoundEntry | None], None]  # told what happens, a sentence, and the round that it is about


def check_hours(table: "Table", hours: float) -> "tuple[list[CandidateMotion], float]":
    """Return the motions that every investigation begins with, and the seconds that its last run takes.

    Raises InputError if these take longer than `hours`, or the table can make no motion.
    """
    from filters.tracing import table_motions

    start, judge = table_motions.start(table), table_motions.held_out(table, None)
    if not start or judge is None:
        raise InputError("the table can't make any motion within its limits. Look at `imutui table status`.")
    reserve_s = judge.seconds + OVERHEAD_S
    least = sum(m.seconds + OVERHEAD_S for m in start) + reserve_s
    if hours * 3600.0 < least:
        raise InputError(
            f"`hours` is {hours:g}; the motions that every unit makes first, and the run that judges, take"
            f" {math.ceil(least / 36.0) / 100.0:.2f} h. Give it that at least."
        )
    return start, reserve_s


@dataclass
class Investigation:
    """One that goes on from its diary.

    Raises InputError if there is not the time for what it takes at least.
    """

    laboratory: Laboratory
    diary: Diary
    tell: Tell = lambda said, entry: None

    def __post_init__(self) -> None:
        self._before_s = self.diary.document["spent_s"]
        self._start, self.reserve_s = check_hours(self.laboratory.table, self.diary.document["hours"])

    @property
    def spent_s(self) -> float:
        """Time in this and earlier sessions, s."""
        return self._before_s + self.laboratory.now_s()

    @property
    def left_s(self) -> float:
        """Time left before the run that judges must begin, s."""
        return self.diary.document["hours"] * 3600.0 - self.spent_s - self.reserve_s

    def pause(self) -> None:
        """Write how much time was spent; what was being made will be made again."""
        self._save()

    def go(self) -> Outcome:
        """Go on to the end."""
        document = self.diary.document
        done = {entry["motion"] for entry in self.diary.made if entry["kind"] == "start"}
        for motion in self._start:
            if motion.description not in done:
                self._make(motion, "start", 0.0, "every effect of the catalogue can be told only after it")
        while not document["outcome"]:
            self._round()
        return document["outcome"]

    def _round(self) -> None:
        """Trace, plan, and make what was planned; or judge."""
        made = self.diary.made
        self.tell(f"tracing {len(made)} runs", None)
        known, planner, degc = self._known()
        self._came(planner.disputes, known)
        settled = _settled(known, planner.disputes)
        chosen = planner.chosen(max(_TOGETHER_S, _SHARE * self.spent_s), only_new=settled)
        fitting = [e for e in chosen if e.motion.seconds + OVERHEAD_S <= self.left_s]
        if fitting:
            for expected in fitting:
                if expected.motion.seconds + OVERHEAD_S <= self.left_s:
                    self._make(expected.motion, "round", expected.bits, _why(expected))
        elif made[-1]["kind"] == "held_out" and made[-1]["power_on"] == self.diary.document["power_on"]:
            # it has judged, and nothing is worth another motion; after a switch one of the new power-on judges
            self._end("time" if chosen else "not_here", known)
        else:
            self._judge(known, degc, in_time=not chosen)

    def _known(self) -> "tuple[Assessment, Planner, float | None]":
        from filters.tracing import planning, table_motions
        from filters.tracing.trace import assessed

        runs = self.laboratory.runs(self.diary.made)
        known = assessed(runs, None)
        temperature = runs[-1].temperature
        degc = None if temperature is None else float(temperature[-1])
        motions = table_motions.rounds(self.laboratory.table, degc)
        begins = max(run.begins + run.seconds for run in runs) + OVERHEAD_S
        before = [entry["motion"] for entry in self.diary.made]
        return known, planning.Planner(known, motions, begins, OVERHEAD_S, before), degc

    def _judge(self, known: "Assessment", degc: float | None, *, in_time: bool) -> None:
        from filters.tracing import table_motions

        again = sum(entry["kind"] == "held_out" for entry in self.diary.made)
        motion = table_motions.held_out(self.laboratory.table, degc, again)
        assert motion is not None
        self._make(motion, "held_out", 0.0, "nothing is fitted to it: it judges what the others have shown")
        self.tell("judging by the last run", None)
        document = self.laboratory.judged(self.diary.made)
        entry = self.diary.made[-1]
        entry["status"] = dict(document["status"])
        entry["came"] = document["sentence"]
        self.diary.save()
        if all(status in ("clean", "explained") for status in document["status"].values()):
            self._end("explained", known)
        elif not in_time:
            self._end("time", known)

    def _make(self, motion: "CandidateMotion", kind: Kind, bits: float, why: str) -> None:
        """Make a motion; the diary has it before, and its log after."""
        document = self.diary.document
        entry: RoundEntry = {
            "kind": kind, "start_s": round(self.spent_s, 1), "motion": motion.description,
            "minutes": round(motion.seconds / 60.0, 2), "expected_bits": round(bits, 2), "why": why, "log": "",
            "power_on": document["power_on"], "rivals": [], "status": {}, "came": "",
        }  # fmt: skip
        document["rounds"].append(entry)
        self._save()
        self.tell(f"{motion.instruction}: {why}", entry)
        entry["log"] = self.laboratory.record(motion, len(document["rounds"]))
        self._save()

    def _save(self) -> None:
        self.diary.document["spent_s"] = round(self.spent_s, 1)
        self.diary.save()

    def _came(self, disputes: "Sequence[Dispute]", known: "Assessment") -> None:
        """Write what is known now to the rounds that have come since the last trace."""
        from filters.tracing.assessment import statuses

        status = cast("dict[str, str]", statuses(known))
        rivals = _rivals(disputes, known)
        settled = [r for r in self.diary.made if r["status"]]
        before = settled[-1] if settled else None
        for entry in self.diary.made:
            if not entry["status"]:
                entry["status"], entry["rivals"] = status, rivals
                entry["came"] = _changes(before, status, rivals)
        self._save()

    def _end(self, outcome: Outcome, known: "Assessment") -> None:
        document = self.diary.document
        document["outcome"] = outcome
        if outcome != "explained":
            document["takes"] = _takes(known, document["rounds"][-1]["status"])
        self._save()


def _rivals(disputes: "Sequence[Dispute]", known: "Assessment") -> list[RivalsEntry]:
    """Disputes by channel, then findings that nobody disputes."""
    made: list[tuple[str, list[str], Sequence[float]]] = [
        (channel, list(q.names), q.odds) for q in disputes for channel in q.channels
    ]
    disputed = {(channel, names[0]) for channel, names, _ in made}
    for f in known.findings:
        effect = f.term.hypothesis.effect
        made += [
            (c, [effect], (f.odds,))
            for c in map(CHANNELS.__getitem__, f.channels)
            if f.lasting and (c, effect) not in disputed
        ]
    return [
        RivalsEntry(channel=channel, names=names, odds=[float(f"{o:.3g}") for o in odds])
        for channel, names, odds in made[:_MOST_ODDS]
    ]


def _settled(known: "Assessment", disputes: "Sequence[Dispute]") -> bool:
    """Whether nothing is left that another motion would show: each channel is explained, or only a power-on lacks."""
    from filters.tracing.assessment import statuses
    from filters.tracing.planning import information

    for channel, status in statuses(known).items():
        disputed = any(channel in d.channels and d.names[1] != NOTHING for d in disputes)
        if status not in ("clean", "explained") and not (status == "confounded" and not disputed):
            return False
    return sum(information(d.probability, 100.0) for d in disputes) < _UNDECIDED


def _why(expected: "Expectation") -> str:
    """Why a motion was chosen, a sentence."""
    parts = []
    if expected.between is not None:
        a, b = map(_plain, expected.between.names)
        parts.append(f"{a} or {b} on {' '.join(expected.between.channels)} ({expected.rivals:.1f} bits)")
    if expected.corrected > 0.05:
        parts.append(f"how large it is ({expected.corrected:.1f} bits)")
    if expected.besides > 0.05:
        parts.append(f"what else acts ({expected.besides:.1f} bits)")
    if expected.new:
        parts.append("such a motion was not made yet")
    return "; ".join(parts)


def _changes(before: RoundEntry | None, status: dict[str, str], rivals: Sequence[RivalsEntry]) -> str:
    """What a trace says that the one before did not, a sentence."""
    was = {} if before is None else before["status"]
    told = [f"{c} {was[c]} → {s}" if c in was else f"{c} {s}" for c, s in status.items() if was.get(c, "clean") != s]
    known = {(r["channel"], *r["names"]): r for r in ([] if before is None else before["rivals"])}
    moved: dict[str, list[str]] = {}
    for now in (r for r in rivals if len(r["names"]) == 2):
        old = known.get((now["channel"], *now["names"]))
        if old is not None and (a := _ratio(old)) and not 0.5 < (b := _ratio(now)) / a < 2.0:
            moved.setdefault(f"{' over '.join(map(_plain, now['names']))} {a:.3g} → {b:.3g}", []).append(now["channel"])
    told += [f"{' '.join(channels)}: {text}" for text, channels in [*moved.items()][:_MOST_MOVED]]
    return "; ".join(told) or ("all channels clean" if before is None else "nothing new")


def _plain(effect: str) -> str:
    return effect if effect == NOTHING else plain_names.effect(effect)


def _ratio(entry: RivalsEntry) -> float:
    return entry["odds"][0] / max(entry["odds"][1], 1e-30)


_TAKES = {
    "stochastic": "it drifts, and nothing that is logged goes with it: log what else may, such as the supply's voltage",
    "run_specific": "what happened there happened once: nothing carries over to another run",
    "unexplained": "something is there that no cause fits: look at its residual in the report",
    "partial": "its cause leaves something, or the last run does not confirm it: more time with other motions",
}


def _takes(known: "Assessment", status: dict[str, str]) -> list[str]:
    """What it would take to explain channels that are not, a sentence each."""
    out = []
    for channel, own in status.items():
        found = [f for f in known.findings if CHANNELS.index(channel) in f.channels]
        slow = any(f.term.hypothesis.source in ("time", "temperature") for f in found)
        if own in ("clean", "explained"):
            continue
        if own == "confounded" and slow:
            out.append(
                f"{channel}: what goes with time or temperature is told apart by another power-on: switch the unit off"
                " until it is cold, or change the temperature in a chamber, and go on (--resume --switched)"
            )
        elif own == "confounded" and known.experiment is not None:
            out.append(f"{channel}: {known.experiment.motion}")
        elif own == "confounded":
            out.append(f"{channel}: no motion of this table tells its causes apart")
        else:
            out.append(f"{channel}: {_TAKES[own]}")
    return out
