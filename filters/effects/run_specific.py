"""What happens within a run and is not the same in the next: tones, steps, two-level noise; where to look for them.

Each search takes a channel's residual, whitened under what is selected already, and gives the best event that it finds.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from filters.compilation import cached_njit
from filters.effects.hypothesis import Hypothesis, Parameter, own_parameter
from filters.types import Array

TONE_HZ = 1.6  # above it tones are sought at the full rate (`effects.lines`), below it here
_PERIODS = 2.5
_PAD = 4
_SWITCHES = 3
_ITERATIONS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class RunSpecific(Hypothesis):
    """An effect with columns of its own rows, in no other run."""

    source: str = "run_specific"
    parameters: tuple[Parameter, ...] = ()
    made: Array = field(default_factory=lambda: np.zeros((0, 1)), repr=False)  # its columns, shape (n, k)
    penalty: float = 0.0  # what choosing it costs


@dataclass(frozen=True, eq=False, kw_only=True)
class Tone(RunSpecific):
    """e = a sin 2π f t + b cos 2π f t, amplitude and phase of each run its own."""

    effect: str = "tone"
    hz: float

    @classmethod
    def of(cls, channel: int, hz: float, made: Array, penalty: float) -> "Tone":
        """Of a frequency, two columns a run."""
        names = [f"{part} run {r + 1}" for r in range(made.shape[1] // 2) for part in ("sin", "cos")]
        own = tuple(own_parameter(channel, name, "", 0.1, 5.0) for name in names)
        words = f"oscillates at {hz:.4g} Hz"
        shape: dict[str, float | str] = {"hz": hz}
        return cls(
            channels=(channel,), parameters=own, shape=shape, words=words, made=made, penalty=penalty, hz=hz
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Step(RunSpecific):
    """e = k from t0 on, in one run, or (`run` -1) at the same time of every run."""

    effect: str = "step"
    at: float
    run: int

    @classmethod
    def of(cls, channel: int, at: float, run: int, made: Array) -> "Step":
        """Of an instant, s, with its column."""
        which = "every run" if run < 0 else f"run {run + 1}"
        return cls(
            channels=(channel,),
            parameters=(own_parameter(channel, "k", "", 0.1, 3.0),),
            shape={"at_s": at, "run": float(run + 1)},
            words=f"bias steps at {at:.1f} s of {which}",
            made=made,
            penalty=2.0 * float(np.log(len(made))),
            at=at,
            run=run,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Telegraph(RunSpecific):
    """e = k s(t), s in {0, 1}."""

    effect: str = "telegraph"


def tone(channel: int, white: Array, t: Array, starts: NDArray[np.int_], period: float, most_hz: float) -> Tone | None:
    """The strongest tone below `most_hz`: sum of the runs' periodograms, refined on a finer grid.

    `white`: whitened residual, shape (n,).
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
    return Tone.of(channel, refined, columns, 2.0 * float(np.log(6.0 * t.size / 2.0)))


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
    return Step.of(channel, float(0.5 * (t[first] + t[first - 1])), -1 if len(rows) > 1 else number, column)


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
    return Telegraph(
        channels=(channel,),
        parameters=(own_parameter(channel, "k", "", 0.05, 2.0),),
        shape={"switches": float(switches)},
        made=s.astype(np.float64)[:, None],
        penalty=switches * _price(switches, r.size),
    )


def _price(switches: int, n: int) -> float:
    """What telling of one switch costs, in chi-square: a two-state Markov chain that switches as often as this one."""
    s = max(1, switches)
    return 2.0 * (float(np.log(n / s)) + 1.0)


def _level(r: Array, sd: Array, use: NDArray[np.bool_]) -> float:
    weight = sd[use] ** -2
    return float(weight @ r[use] / weight.sum())


@cached_njit
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
