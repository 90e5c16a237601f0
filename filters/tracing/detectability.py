"""The smallest size of an effect that a log would show: detectability d = 5, d the effect over the white noise."""

from collections.abc import Collection
from typing import Any

import numpy as np

from filters.effects import events
from filters.effects.catalogue import EFFECTS
from filters.effects.hypothesis import DPS, MG
from filters.imu import CHANNELS
from filters.tracing.design_matrix import Atom, Design

D = 5.0


def limits(design: Design, channels: list[int], effect: str, found: Collection[object]) -> list[dict[str, Any]]:
    """Limits of one effect.

    Parameters
    ----------
    design : Design
        Of the runs.
    channels : list of int
        Those with data.
    effect : str
        In the catalogue.
    found : collection
        Keys of the atoms that were found: they need no limit.

    Returns
    -------
    list of dict
        effect, channels, limit, unit, text; a deterministic effect of several parameters has a limit for each. One
        without limit where the log can't show the effect at all, or it has no size to be too small.
    """
    if EFFECTS[effect].kind in ("event", "drift"):
        return [_of_process(design, c, effect) for c in channels]
    atoms = [a for a in design.atoms if a.hypothesis.effect == effect and set(a.places) & set(channels)]
    faint = [a for a in atoms if a.key not in found]
    made = [entry for atom in faint for entry in _of_atom(design, atom)]
    if made or (atoms and not faint) or EFFECTS[effect].kind not in ("additive", "motion"):
        return made
    text = "this log can't show it, whatever its size"
    return [{"effect": effect, "channels": [], "limit": None, "unit": "", "text": text}]


def _of_atom(design: Design, atom: Atom) -> list[dict[str, Any]]:
    """Limit of each parameter, the others being nothing."""
    h = atom.hypothesis
    out = []
    for k, p in enumerate(h.parameters()):
        information = sum(float(design.gram(c)[0][places[k], places[k]]) for c, places in atom.places.items())
        raw = max(float(design.raw[places[k]]) for places in atom.places.values())
        if information <= 1e-9 * raw**2 * design.stack.t.size:
            continue
        limit = D / float(np.sqrt(information)) / p.si
        shape = [f"{name} {value}" for name, value in h.shape().items()]
        words = ", ".join([p.name, *shape] if atom.size > 1 else shape)
        out.append(_entry(h.effect, [CHANNELS[c] for c in h.channels], limit, p.unit, words))
    return out


def _of_process(design: Design, c: int, effect: str) -> dict[str, Any]:
    """Limit of a tone's amplitude, of a jump halfway, of a drift's level, from length and white density alone."""
    stack = design.stack
    total = stack.seconds(c)
    run = total / len(stack.blocks)
    white = float(design.sd[c]) * float(np.sqrt(stack.period))
    unit, si = ("deg/s", DPS) if c < 3 else ("mg", MG)
    size, words = {
        events.Tone.effect: (np.sqrt(2.0 / total), "amplitude"),
        events.Step.effect: (2.0 / np.sqrt(run), "halfway through a run"),
        events.Telegraph.effect: (2.0 / np.sqrt(total), "as often up as down"),
        "gauss_markov": (1.0 / np.sqrt(total), "standard deviation, slow against a run"),
        "random_walk": (np.sqrt(6.0) / run, "in a run"),
    }[effect]
    own = f"{unit}/√s" if effect == "random_walk" else unit
    return _entry(effect, [CHANNELS[c]], D * white * float(size) / si, own, words)


def _entry(effect: str, channels: list[str], limit: float, unit: str, words: str) -> dict[str, Any]:
    said = f" {unit}" if unit != "1" else ""
    text = f"below what this log can show (limit {limit:.3g}{said}{', ' + words if words else ''})"
    return {"effect": effect, "channels": channels, "limit": limit, "unit": unit, "text": text}
