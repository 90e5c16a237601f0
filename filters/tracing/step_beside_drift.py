"""A step of a channel that drifts: sought in what is whitened, for a drift takes a clean step for its own.

Steps are tried every few seconds, of one power-on and of all at the same time, on coarse rows under the drift as it is
and weaker ones; the best is then placed to a block. What it leaves out: steps of a constant bias
(`effects.run_specific`), and whether it is one (`selection`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from filters.effects.run_specific import Step
from filters.tracing.beside_drift import Rows, rows_of
from filters.tracing.columns import Term
from filters.tracing.design_matrix import Design, inverse_of
from filters.tracing.whitening import Drift, whiten
from filters.types import Array

_WEAKER = (1.0, 0.5, 0.25, 0.1)
"""Of the drift as it is: a step that is taken for drift makes it stronger."""
_TRIED = 300
_LEAST_S = 4.0
_END_S = 3.0
"""Nearer to an end of a power-on a step is no more than a few odd readings."""


def step(design: Design, selection: Sequence[Term], channel: int) -> Step | None:
    """The most likely step beside drift.

    `design`: data, columns, and the channel's drift.
    `selection`: what is selected.
    Returns none if no power-on is long enough.
    """
    stack = design.stack
    rows = rows_of(design, selection, channel, np.zeros((stack.t.size, 0)))
    number = np.searchsorted(rows.starts, np.arange(rows.t.size), side="right") - 1
    places = _places(rows, number)
    if not places:
        return None
    columns = np.stack([_of(rows.t, number, *place) for place in places], axis=1)
    _, k, drift = min(_best(rows, columns, own) for own in _weaker(design.drift[channel]))
    at, which = places[k]
    spacing = _spacing(rows)
    near = np.arange(at - spacing, at + spacing, stack.period)
    near = near[(near > at - spacing) & _inside(rows, near, which)]
    if not near.size:
        return None
    fine = np.stack([_of(stack.t, stack.power_on, x, which) for x in near.tolist()], axis=1)
    own_columns = [design.columns[:, a.places[channel]] for a in selection if channel in a.places]
    raw = np.column_stack([design.unexplained(selection, channel), *own_columns, fine])
    W = design.white(raw, channel, drift)
    S, X = W[:, 1 : -near.size], W[:, -near.size :]
    gains = _gains(W[:, 0] - _projected(S, W[:, 0]), S, X)
    best = int(np.argmax(gains))
    made, at = fine[:, best, None], float(near[best])
    facts = {"at_s": at, "run": float(which + 1)}
    return Step(channel, made=made, penalty=2.0 * float(np.log(stack.t.size)), facts=facts, at=at, run=which)


def _weaker(drift: Drift) -> list[Drift]:
    return [Drift(drift.tau, share * drift.level) for share in _WEAKER]


def _spacing(rows: Rows) -> float:
    ends = np.append(rows.starts[1:], rows.t.size) - 1
    return max(_LEAST_S, float(np.sum(rows.t[ends] - rows.t[rows.starts])) / _TRIED)


def _places(rows: Rows, number: NDArray[np.int_]) -> list[tuple[float, int]]:
    """Instants and the power-on of steps to try; -1: in all."""
    spacing = _spacing(rows)
    count = rows.starts.size
    out = []
    for which in (*range(count), *([-1] if count > 1 else [])):
        last = max(float(rows.t[number == k].max()) for k in range(count) if which in (k, -1))
        tried = np.arange(spacing, last, spacing)
        out += [(x, which) for x in tried[_inside(rows, tried, which)].tolist()]
    return out


def _inside(rows: Rows, at: Array, which: int) -> NDArray[np.bool_]:
    """Whether instants are far enough from the ends of a power-on, or of one at least."""
    ends = np.append(rows.starts[1:], rows.t.size) - 1
    first, last = rows.t[rows.starts] + _END_S, rows.t[ends] - _END_S
    inside = (at[:, None] > first) & (at[:, None] < last)
    return np.asarray(inside.any(axis=1) if which < 0 else inside[:, which], np.bool_)


def _of(t: Array, number: NDArray[np.int_], at: float, which: int) -> Array:
    """A step at an instant, shape (n,)."""
    return np.asarray((t >= at) & ((number == which) | (which < 0)), np.float64)


def _best(rows: Rows, columns: Array, drift: Drift) -> tuple[float, int, Drift]:
    """-2 log likelihood with the best step under a drift, its number, the drift."""
    W, log_det = whiten(np.hstack([rows.values, columns]), rows.t, rows.starts, rows.variance, drift)
    S, X = W[:, 1 : 1 + rows.selected], W[:, 1 + rows.selected :]
    left = W[:, 0] - _projected(S, W[:, 0])
    gains = _gains(left, S, X)
    k = int(np.argmax(gains))
    return float(left @ left) + log_det - float(gains[k]), k, drift


def _gains(left: Array, S: Array, X: Array) -> Array:
    """What each column gains beside the columns of S, which are fitted to y already."""
    cross = S.T @ X
    own = np.einsum("ij,ij->j", X, X) - np.einsum("ij,ij->j", cross, inverse_of(S.T @ S) @ cross)
    return np.asarray(np.where(own > 1e-6 * own.max(), (X.T @ left) ** 2 / np.maximum(own, 1e-300), 0.0))


def _projected(S: Array, y: Array) -> Array:
    return np.asarray(S @ (inverse_of(S.T @ S) @ (S.T @ y)))
