"""What else would do in the place of an effect that was found: same evidence, or the same part explained."""

from dataclasses import dataclass

from filters.effects import deterministic
from filters.effects.run_specific import RunSpecific
from filters.tracing.columns import Term
from filters.tracing.selection import Selection

_EVIDENCE = 6.0
_SAME_PART = 0.97
_MOST = 6


@dataclass(frozen=True)
class Rival:
    """Another effect that would do in the place of one that was found; `weight` where forms were averaged."""

    term: Term
    score_difference: float
    weight: float | None = None


def rivals(chosen: Selection, term: Term) -> list[Rival]:
    """Effects that would explain the same, the best first, one form of each.

    `chosen`: with the term in it.
    `term`: whose place they would take.
    """
    design = chosen.design
    if isinstance(term.hypothesis, RunSpecific):
        return []
    rest = [a for a in chosen.terms if a is not term]
    own = float(design.gains(rest, [term])[0])
    score = own - chosen.price(term)
    taken = {a.key for a in rest}
    others = [
        b
        for b in design.terms
        if b.key not in taken
        and b.hypothesis.effect != term.hypothesis.effect
        and (set(term.places) <= set(b.places) or (len(term.places) > 1 and len(b.places) > 1))
    ]
    gains = design.gains(rest, others)
    found: dict[str, Rival] = {}
    if term.hypothesis.effect == "gravity":  # always a pair: no motion separates them
        found["scale"] = Rival(Term(deterministic.common_scale(), term.places), 0.0)
    for b, gain in sorted(zip(others, gains.tolist(), strict=True), key=lambda pair: chosen.price(pair[0]) - pair[1]):
        difference = gain - chosen.price(b) - score
        close = difference > -_EVIDENCE or (gain >= _SAME_PART * own and b.size <= term.size + 1)
        if not close or b.hypothesis.effect in found or contains(b, term):
            continue
        found[b.hypothesis.effect] = Rival(b, difference)
        if len(found) >= _MOST:
            break
    return list(found.values())


def contains(b: Term, a: Term) -> bool:
    """Whether b is a wider form of a: the same physics, or a free curve over what a is a function of."""
    h, wide = a.hypothesis, b.hypothesis
    if b.size <= a.size:
        return False
    if wide.effect == "thermal_poly":
        return h.effect == "thermal_lin"
    return len(h.over) == 1 and wide.effect == f"driver:{h.over[0]}"
