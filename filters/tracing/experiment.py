"""The motion and the temperatures that would separate an effect from its rivals.

Of two effects A and B that the runs at hand show alike, with S all else that was found, a further run adds

    d² = Σ_c |(I - P[const, S, B]) φ_A θ_A|² / σ_c²   over all runs together, less the same over the runs at hand

if A is what there is: what no mixture of the others can follow, in standard deviations of the noise. Parameters of S
and B hold for all runs, the constant is each run's own. Regressors of the further run need no data; white noise, and
drift where a channel has it, are those found. d ≥ 5 separates.

With several rivals the candidate counts that separates most of them, by the least d that it adds there for its time.

What it leaves out: what can be done at all (`filters.tracing.candidate_motions`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from filters.effects.run_specific import RunSpecific
from filters.tracing import candidate_motions
from filters.tracing.blocks import average
from filters.tracing.candidate_motions import CandidateMotion
from filters.tracing.columns import ColumnsByTerm, Term, columns_on
from filters.tracing.design_matrix import Design
from filters.tracing.result import SeparatingExperiment
from filters.tracing.run import Run
from filters.tracing.stack import Stack
from filters.tracing.trace_document import SEPARATES
from filters.tracing.whitening import unbiased, whiten
from filters.types import Array

_NOTHING = 1.0
_UNIT_S = 600.0
_BLOCK_S = {candidate_motions.STILL_HZ: 2.0, candidate_motions.MOVING_HZ: 0.5}
_DEPENDENT = 1e-7
_ABSURD = 100.0


@dataclass(frozen=True)
class EvaluatedMotion:
    """A candidate, and the d that it adds against each rival, in their order."""

    candidate: CandidateMotion
    d: tuple[float, ...]

    @property
    def separated(self) -> tuple[int, ...]:
        """Numbers of the rivals that it separates."""
        return tuple(n for n, d in enumerate(self.d) if d >= SEPARATES)

    @property
    def hardest(self) -> int:
        """Number of the rival of the least d that it separates; of the greatest where there is none."""
        if self.separated:
            return min(self.separated, key=lambda n: self.d[n])
        return int(np.argmax(self.d))

    @property
    def expected(self) -> float:
        """The d against that rival."""
        return self.d[self.hardest]

    @property
    def rank(self) -> tuple[int, float]:
        """What it separates, and its d per √(10 min); the d alone where it separates nothing."""
        time = math.sqrt(self.candidate.seconds / _UNIT_S) if self.separated else 1.0
        return len(self.separated), self.expected / time


class CandidateRuns:
    """Candidates for a unit whose runs are in a design, made ready once for any number of effects.

    `like`: one of them: how the unit sits.
    """

    def __init__(self, design: Design, like: Run) -> None:
        self.design = design
        self._like = like
        self._observed = candidate_motions.ObservedRange.of(design.stack)
        self._candidates: dict[bool, list[CandidateMotion]] = {}
        self._stacks: dict[int, Stack] = {}

    def options(
        self, a: Term, theta: Array, rivals: Sequence[Term], rest: Sequence[Term] = ()
    ) -> list[EvaluatedMotion]:
        """What each candidate adds, the best first.

        `a`: what was found,
        `theta`: with its parameters, SI, shape (k,).
        `rivals`: at least one.
        """
        pairs = [Pair(self.design, a, theta, b, rest) for b in rivals]
        lasting = list({term.key: term for pair in pairs for term in pair.lasting}.values())
        moving = any(term.hypothesis.source == "motion" for term in (a, *rivals))
        made = []
        for candidate in self._of(moving):
            stack = self._stack(candidate)
            columns = columns_on(stack, lasting)
            made.append(EvaluatedMotion(candidate, tuple(pair.added(stack, columns) for pair in pairs)))
        return sorted(made, key=lambda option: option.rank, reverse=True)

    def _of(self, moving: bool) -> list[CandidateMotion]:
        """Candidates without motion for what does not depend on any."""
        if True not in self._candidates:
            self._candidates = {True: candidate_motions.candidates(self._observed, moving=True)}
            self._candidates[False] = [candidate for candidate in self._candidates[True] if candidate.still]
        return self._candidates[moving]

    def _stack(self, candidate: CandidateMotion) -> Stack:
        if id(candidate) not in self._stacks:
            blocks = average(candidate.run(self._like), _BLOCK_S.get(candidate.rate_hz, self.design.stack.period))
            self._stacks[id(candidate)] = Stack.of([blocks])
        return self._stacks[id(candidate)]


class Pair:
    """Two rivals, beside the rest: what runs tell of the first that the others can't follow.

    Without `b` the rival is that there is nothing.
    """

    def __init__(self, design: Design, a: Term, theta: Array, b: Term | None, rest: Sequence[Term]) -> None:
        self._design, self._a, self._theta = design, a, theta
        rival = [] if b is None else [b]
        self._channels = [c for c in sorted({c for x in (a, *rival) for c in x.places}) if design.sd[c] > 0.0]
        self._others = [*rival, *(s for s in rest if s is not a and set(s.places) & set(self._channels))]
        self.lasting = [x for x in (a, *self._others) if not isinstance(x.hypothesis, RunSpecific)]
        self._known = self._triangle(design.stack, {})
        self._before = _unfollowed(self._known)

    def added(self, stack: Stack, columns: ColumnsByTerm) -> float:
        """D that a further run adds, with the columns of all that lasts on it."""
        both = np.vstack([self._known, self._triangle(stack, columns)])
        return math.sqrt(max(0.0, _unfollowed(both) ** 2 - self._before**2))

    def take(self, stack: Stack, columns: ColumnsByTerm) -> None:
        """Count a further run as one that is made: what others add is added to what it does."""
        both = np.vstack([self._known, self._triangle(stack, columns)])
        self._known = np.asarray(np.linalg.qr(both, mode="r"))

    def _triangle(self, stack: Stack, made: ColumnsByTerm) -> Array:
        """R of the QR decomposition of whitened columns of all channels: the others, then that of A."""
        return np.asarray(np.linalg.qr(np.vstack([self._white(stack, made, c) for c in self._channels]), mode="r"))

    def _white(self, stack: Stack, made: ColumnsByTerm, c: int) -> Array:
        parts = [self._columns(stack, made, term, c) for term in self._others]
        raw = np.column_stack([*parts, self._columns(stack, made, self._a, c) @ self._theta])
        return self._design.white(raw, c) if stack is self._design.stack else white_on(self._design, stack, raw, c)

    def _columns(self, stack: Stack, made: ColumnsByTerm, term: Term, c: int) -> Array:
        """Columns of a term on a channel; an event of the runs at hand does not happen again."""
        if c not in term.places:
            return np.zeros((stack.t.size, term.size))
        if stack is self._design.stack:
            return self._design.columns[:, term.places[c]]
        return made.get((term.key, c), np.zeros((stack.t.size, term.size)))


def white_on(design: Design, stack: Stack, raw: Array, channel: int) -> Array:
    """Columns of a further run, whitened by the noise and the drift that the channel has in the runs at hand."""
    variance = np.full(stack.t.size, design.sd[channel] ** 2 * design.stack.period / stack.period)
    drift = design.drift[channel]
    if drift.level == 0.0:
        return unbiased(raw, stack.power_on, variance)
    return whiten(raw, stack.t, stack.begins, variance, drift)[0]


def _unfollowed(columns: Array) -> float:
    """Norm of the last column's part that the others can't follow."""
    scale = np.linalg.norm(columns[:, :-1], axis=0)
    others = columns[:, :-1] / np.where(scale > 0.0, scale, 1.0)
    theta = np.linalg.lstsq(others, columns[:, -1], rcond=_DEPENDENT)[0]
    return float(np.linalg.norm(columns[:, -1] - others @ theta))


def separating(
    design: Design,
    a: Term,
    theta: Array,
    rivals: Sequence[Term],
    run: Run,
    rest: Sequence[Term] = (),
    candidate_runs: CandidateRuns | None = None,
) -> SeparatingExperiment | None:
    """The run to make next to tell an effect from its rivals.

    `a`: what was found,
    `theta`: with its parameters, SI, shape (k,).
    `rivals`: what would do in its place, the strongest first; none of them contains it. Whatever would have to be a
      hundred times of plausible size is left out, as long as two remain: such as a scale factor that makes all of a
      drift of Earth rate. If that is `a`, the strongest rival takes its place.
    `candidate_runs`: that of the design, where several effects are asked for.
    Returns none if nothing would tell them apart at all.
    """
    a, theta, rivals = _possible(design, a, theta, rivals, rest)
    if not rivals:
        return None
    options = (candidate_runs or CandidateRuns(design, run)).options(a, theta, rivals, rest)
    if not options or options[0].expected < _NOTHING:
        return None
    best = options[0]
    unseparated = tuple(b.hypothesis.effect for n, b in enumerate(rivals) if n not in best.separated)
    return SeparatingExperiment(
        a=a.hypothesis.effect,
        b=rivals[best.hardest].hypothesis.effect,
        profile=best.candidate.profile,
        thermal=best.candidate.thermal,
        duration_s=best.candidate.seconds,
        d_expected=best.expected,
        motion=_sentence(options, unseparated),
        leaves=unseparated,
    )


def _possible(
    design: Design, a: Term, theta: Array, rivals: Sequence[Term], rest: Sequence[Term]
) -> tuple[Term, Array, Sequence[Term]]:
    """An effect and its rivals without those that are absurd in size."""
    others = [s for s in rest if s is not a]
    fitted = [(a, theta), *((b, design.fit([*others, b]).theta[-1]) for b in rivals)]
    able = [(term, own) for term, own in fitted if not _absurd(term, own)]
    if len(able) < 2:
        return a, theta, rivals
    return able[0][0], able[0][1], [term for term, _ in able[1:]]


def _absurd(term: Term, theta: Array) -> bool:
    """Whether a parameter is a hundred times of plausible size."""
    sizes = zip(term.hypothesis.parameters, theta.tolist(), strict=True)
    return any(p.prior > 0.0 and abs(value / p.si) > _ABSURD * p.prior for p, value in sizes)


def _sentence(options: Sequence[EvaluatedMotion], unseparated: Sequence[str]) -> str:
    """What to do; without a chamber too, if that will do as well; or that nothing will."""
    best = options[0]
    if not best.separated:
        nearest = f"nearest comes {best.expected:.1f} sd apart of {SEPARATES:.0f}: {best.candidate.instruction}"
        return f"nothing known separates them; {nearest}"
    text = best.candidate.instruction
    if unseparated:
        text += f" ({' and '.join(unseparated)} would stay possible)"
    plain = next((o for o in options if not o.candidate.chamber), best)
    if plain is best or not set(plain.separated) >= set(best.separated):
        return text
    return f"{text}; or, without a chamber: {plain.candidate.instruction} ({plain.expected:.0f} sd apart)"
