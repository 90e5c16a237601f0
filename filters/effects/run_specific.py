"""What happens within a run and is not the same in the next: tones, steps, two-level noise; where to look for them.

Each search takes a channel's residual, whitened under what is selected already, and gives the best event that it finds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from filters.effects.hypothesis import ChannelEffect, Parameter
from filters.effects.inputs import Inputs
from filters.types import Array

TONE_HZ = 1.6
"""Above it tones are sought at the full rate (`effects.lines`), below it here."""
_PERIODS = 2.5
_PAD = 4
_SWITCHES = 3
_ITERATIONS = 8


@dataclass(frozen=True)
class RunSpecific(ChannelEffect):
    """An effect with columns of its own rows; `made` are those, shape (n, k)."""

    made: Array = field(default_factory=lambda: np.zeros((0, 1)), compare=False, repr=False)
    penalty: float = 0.0
    facts: Mapping[str, float | str] = field(default_factory=dict, compare=False)
    count: int = 1

    source: ClassVar = "run_specific"

    def columns(self, inputs: Inputs, channel: int) -> Array:
        """Not a function of the drivers: what happened at the rows it was found on."""
        return self.made

    def shape(self) -> Mapping[str, float | str]:
        return self.facts


@dataclass(frozen=True)
class Tone(RunSpecific):
    """e = a sin 2π f t + b cos 2π f t, amplitude and phase of each run its own."""

    hz: float = 0.0

    effect: ClassVar = "tone"
    text: ClassVar = "oscillates"

    @property
    def label(self) -> str:
        return f"oscillates at {self.hz:.4g} Hz"

    def parameters(self) -> tuple[Parameter, ...]:
        names = [f"{part} run {r + 1}" for r in range(self.count // 2) for part in ("sin", "cos")]
        return tuple(self.channel_parameter(name, "", 1.0, 0.1, 5.0)[0] for name in names)


@dataclass(frozen=True)
class Step(RunSpecific):
    """e = k from t0 on, in one run, or (`run` -1) at the same time of every run."""

    at: float = 0.0
    run: int = 0

    effect: ClassVar = "step"
    text: ClassVar = "bias steps"

    @property
    def label(self) -> str:
        return f"bias steps at {self.at:.1f} s of {'every run' if self.run < 0 else f'run {self.run + 1}'}"

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "", 1.0, 0.1, 3.0)


@dataclass(frozen=True)
class Telegraph(RunSpecific):
    """e = k s(t), s in {0, 1}."""

    switches: int = 0

    effect: ClassVar = "telegraph"
    text: ClassVar = "bias jumps between two levels"

    def parameters(self) -> tuple[Parameter, ...]:
        return self.channel_parameter("k", "", 1.0, 0.05, 2.0)


def tone(channel: int, white: Array, t: Array, starts: NDArray[np.int_], period: float, most_hz: float) -> Tone | None:
    """The strongest tone below `most_hz`: sum of the runs' periodograms, refined on a finer grid.

    `white`: whitened residual, shape (n,).
    `t`: s, shape (n,).
    `starts`: first row of each run.
    `period`: of a row, s.
    `most_hz`: above it nothing is sought.
    Returns none if the runs are too short.
    """
    parts = np.split(np.arange(t.size), starts[1:])
    longest = int(max(part.size for part in parts))
    size = 1 << int(np.ceil(np.log2(longest * _PAD)))
    hz = np.fft.rfftfreq(size, period)
    power = np.zeros(hz.size)
    for part in parts:
        place = np.round((t[part] - t[part[0]]) / period).astype(int)
        signal = np.zeros(size)
        signal[np.minimum(place, size - 1)] = white[part]
        power += 2.0 * np.abs(np.fft.rfft(signal)) ** 2 / max(1, int(np.count_nonzero(white[part])))
    allowed = (hz > _PERIODS / (longest * period)) & (hz < min(most_hz, 0.475 / period))
    if not allowed.any():
        return None
    best = float(hz[allowed][np.argmax(power[allowed])])
    fine = best + np.linspace(-1.0, 1.0, 17) / (size * period)
    refined = float(fine[np.argmax([_power(f, white, t, parts) for f in fine.tolist()])])
    columns = np.zeros((t.size, 2 * len(parts)))
    for k, part in enumerate(parts):
        columns[part, 2 * k] = np.sin(2.0 * np.pi * refined * t[part])
        columns[part, 2 * k + 1] = np.cos(2.0 * np.pi * refined * t[part])
    penalty = 2.0 * float(np.log(6.0 * t.size / 2.0))
    return Tone(channel, made=columns, penalty=penalty, facts={"hz": refined}, count=columns.shape[1], hz=refined)


def _power(hz: float, white: Array, t: Array, parts: list[NDArray[np.int_]]) -> float:
    total = 0.0
    for part in parts:
        phase = 2.0 * np.pi * hz * t[part]
        own = white[part]
        total += float((np.cos(phase) @ own) ** 2 + (np.sin(phase) @ own) ** 2) / part.size
    return total


def step(channel: int, white: Array, basis: Array, t: Array, starts: NDArray[np.int_]) -> Step | None:
    """The best step, for a bias that is constant but for it.

    `white`: residual over its standard deviation less each run's mean, with the fit of what is selected taken off;
      (n,).
    `basis`: orthonormal basis of the selected columns, whitened, shape (n, s).
    `t`, `starts`: time, s, and first row of each run.
    """
    ends = np.append(starts[1:], t.size)
    parts = []
    for a, b in zip(starts.tolist(), ends.tolist(), strict=True):
        n = b - a
        after = np.arange(n - 1, 0, -1)
        # the step less its mean, times anything of mean zero, is a sum from t0 on
        size = after * (n - after) / max(n, 1) - np.sum(_tail(basis[a:b]) ** 2, axis=1)
        parts.append((_tail(white[a:b]), np.where(size > 0.02 * after, size, np.inf)))
    singles = [_best(*part) for part in parts]
    number = int(np.argmax([gain for gain, _ in singles]))
    gain, row = singles[number]
    rows = [(number, row)]
    if len(parts) > 1:
        shortest = min(top.size for top, _ in parts)
        together = sum(top[:shortest] for top, _ in parts), sum(size[:shortest] for _, size in parts)
        common, row = _best(np.asarray(together[0]), np.asarray(together[1]))
        if common > gain:
            gain, rows = common, [(k, row) for k in range(len(parts))]
    if gain <= 0.0:
        return None
    column = np.zeros((t.size, 1))
    for k, row in rows:
        column[starts[k] + row : ends[k], 0] = 1.0
    number, first = rows[0][0], starts[rows[0][0]] + rows[0][1]
    at = float(0.5 * (t[first] + t[first - 1]))
    which = -1 if len(rows) > 1 else number
    facts = {"at_s": at, "run": float(which + 1)}
    penalty = 2.0 * float(np.log(t.size))
    return Step(channel, made=column, penalty=penalty, facts=facts, at=at, run=which)


def _best(top: Array, size: Array) -> tuple[float, int]:
    """Largest gain of a step, and its row."""
    if top.size < 8:
        return 0.0, 0
    gain = top**2 / size
    gain[:3], gain[-3:] = 0.0, 0.0
    k = int(np.argmax(gain))
    return float(gain[k]), k + 1


def _tail(x: Array) -> Array:
    """Sums from row 1, 2, … to the end."""
    return np.asarray(np.cumsum(x[::-1], axis=0)[::-1][1:])


def telegraph(channel: int, r: Array, sd: Array, starts: NDArray[np.int_]) -> Telegraph | None:
    """Two levels by Viterbi: the levels and the sequence in turns, a price on each switch.

    `r`: residual under what is selected, SI, shape (n,).
    `sd`: of each row, infinite without data.
    `starts`: first row of each run.
    Returns none with fewer than three switches.
    """
    use = np.isfinite(sd)
    if use.sum() < 64:
        return None
    price = 2.0 * float(np.log(r.size))
    smooth = np.convolve(np.where(use, r, 0.0), np.ones(9) / 9.0, "same")
    low, high = np.quantile(smooth[use], [0.15, 0.85])
    s, free = np.zeros(r.size, bool), np.zeros(r.size, bool)
    free[starts] = True
    for _ in range(_ITERATIONS):
        cost = np.stack([((r - low) / sd) ** 2, ((r - high) / sd) ** 2], axis=1)
        s = _viterbi(np.where(use[:, None], cost, 0.0), price, free)
        if not (s & use).any() or not (~s & use).any():
            return None
        low, high = _level(r, sd, ~s & use), _level(r, sd, s & use)
        price = _price(int(np.count_nonzero(np.diff(s.astype(int)))), r.size)
    switches = int(np.count_nonzero(np.diff(s.astype(int)))) - int(np.count_nonzero(s[starts[1:]] != s[starts[1:] - 1]))
    if switches < _SWITCHES:
        return None
    facts = {"switches": float(switches)}
    penalty = switches * _price(switches, r.size)
    made = s.astype(np.float64)[:, None]
    return Telegraph(channel, made=made, penalty=penalty, facts=facts, switches=switches)


def _price(switches: int, n: int) -> float:
    """What telling of one switch costs, in chi-square: a two-state Markov chain that switches as often as this one."""
    s = max(1, switches)
    return 2.0 * (float(np.log(n / s)) + 1.0)


def _level(r: Array, sd: Array, use: NDArray[np.bool_]) -> float:
    weight = sd[use] ** -2
    return float(weight @ r[use] / weight.sum())


@njit(cache=True, nogil=True)
def _viterbi(cost, price, free):  # type: ignore[no-untyped-def]
    """Cheapest sequence of two states, a switch costing `price` but where it is free."""
    n = len(cost)
    from_other = np.zeros((n, 2), np.bool_)
    a = b = 0.0
    for k in range(n):
        p = 0.0 if free[k] else price
        from_other[k, 0], from_other[k, 1] = b + p < a, a + p < b
        a, b = min(a, b + p) + cost[k, 0], min(b, a + p) + cost[k, 1]
    out = np.zeros(n, np.bool_)
    state = 1 if b < a else 0
    for k in range(n - 1, -1, -1):
        out[k] = state == 1
        if from_other[k, state]:
            state = 1 - state
    return out
