"""Integrity of one run at the full rate: readings and stamps that are not what the sensor felt (29-33).

`find` looks at each channel by itself, at the instrument's own readings, and says which of them must not be used. What
it leaves out: what to do about blocks with such readings, and why it happened.

Every threshold is a bound on what noise does by chance: noise of any colour, for what is compared is one reading with
its neighbours, against the differences seen in the 2 s around it and in the whole run.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from filters.channels import CHANNELS
from filters.effects import quantisation, time_stamps
from filters.effects.time_stamps import StampQuality
from filters.types import Array

SPIKE = 7.0
"""Standard deviations of one reading, from the median of it and its two neighbours."""

COARSE = 3.5
"""Times the nominal count; or times the noise, where that is not known. A mean follows the input to 2 % of the step at
2.6 times and to 6 % at 3.5 times: quantisation is then no noise any more."""

_SATURATED = 0.2  # share of the readings around that is
_FELT = 3.0  # standard deviations
_NEAR = 8  # readings on each side of a spike that are quiet
_FALSE = 1e-3  # false ones expected in a run
_LEAST_RUN = 5  # readings alike
_RUN_MARGIN = 2.0
_OVER_USUAL = 3.0  # times the length that all but one in a hundred repetitions have
_LEAST_PILE = 5
_PILE = 3.0  # times what a smooth distribution has
_LEAST_CHANGES = 10
_CHANCE_OF_POWERS = 0.05
_SHOWN = 3
_Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class DataFault:
    """A fault of the data, on one channel, or on all for stamps.

    Attributes
    ----------
    effect : str
        "spikes", "stuck", "saturation", "coarse", "dropout" or "jitter".
    channels : tuple of str
        Of gx, gy, gz, ax, ay, az.
    count : int
        Spikes; stretches stuck; readings at the limit; readings on a coarse lattice; gaps; steps between stamps that
        are off.
    where : str
        Where and what, in words: "12.3 s, 44.1 s and 10 more".
    size : float or None
        Median size of the spikes, the limit, or the lattice, in rad/s or m/s²; the longest stretch stuck, the longest
        gap, or the standard deviation of stamps, in s.
    """

    effect: str
    channels: tuple[str, ...]
    count: int
    where: str
    size: float | None = None


@dataclass(frozen=True, slots=True)
class _Channel:
    """One channel of a run, and what its readings are like."""

    name: str
    t: Array
    reading: Array
    error: Array  # reading minus perfect, (N,); the reading itself where that is unknown
    perfect: Array  # (N,) or (1,), NaN where unknown
    lsb: float | None
    lattice: float
    others: Array  # readings of the two channels beside it, (N, 2)
    width: int
    scales: Array  # noise of each window of `width`; of windows in which nothing changes, the median of the others


def find(t: Array, reading: Array, perfect: Array, lsb: Array | None) -> tuple[_Bools, list[DataFault]]:
    """Faults of one run, and the readings that must not be used.

    spikes      ∣e - median(e₋, e, e₊)∣ > 7 σ, and more than two and a half steps of the lattice, e = reading - perfect
    stuck       more equal readings in a row than q^L allows, q the most that a step of the lattice holds of the noise
    saturation  more readings at the extreme value than the values just inside let expect
    coarse      readings a step apart that is above 3.5 counts, or where counts are unknown, 3.5 σ
    dropout     a step between stamps above max(2.5 T, T + 8 jitter)
    jitter      stamps off by more than 2 % of the period, or in bursts

    Parameters
    ----------
    t : Array
        Stamps, s, shape (N,).
    reading : Array
        Rates (rad/s) and accelerations (m/s²) as the instrument shows them, its axes and sign, shape (N, 6).
    perfect : Array
        What a unit without errors would show, shape (N, 6) or (1, 6); NaN where unknown.
    lsb : Array or None
        Size of a count, rad/s and m/s², shape (6,).

    Returns
    -------
    flagged : boolean array
        Spikes, stuck and saturated readings, shape (N, 6).
    faults : list of DataFault

    Raises
    ------
    ValueError
        If shapes do not fit together.
    """
    if reading.shape != (t.size, len(CHANNELS)) or perfect.shape not in (reading.shape, (1, len(CHANNELS))):
        raise ValueError(f"`reading` has shape {reading.shape} and `perfect` {perfect.shape} for {t.size} stamps")
    flagged = np.zeros(reading.shape, np.bool_)
    faults: list[DataFault] = []
    if t.size < quantisation.LEAST_WINDOW:
        return flagged, faults
    stamps = time_stamps.analyse(t)
    for c in range(len(CHANNELS)):
        channel = _channel(c, t, reading, perfect, lsb, stamps.period)
        flagged[:, c] = _of_channel(channel, faults)
    return flagged, faults + _of_stamps(t, stamps)


def _channel(c: int, t: Array, reading: Array, perfect: Array, lsb: Array | None, period: float) -> _Channel:
    x = np.ascontiguousarray(reading[:, c])
    known = np.ascontiguousarray(perfect[:, c])
    error = np.where(np.isnan(known), x, x - known)
    count = None if lsb is None else float(lsb[c])
    width = quantisation.window(1.0 / period if period > 0.0 else 1.0, t.size - 1)
    lattice = quantisation.lattice(x, count)
    beside = reading[:, [3 * (c // 3) + (c + k) % 3 for k in (1, 2)]]
    return _Channel(CHANNELS[c], t, x, error, known, count, lattice, beside, width, _alive(error, x, width))


def _alive(error: Array, reading: Array, width: int, order: int = 1) -> Array:
    """Noise of each window; where the reading is stuck all the while, that of the others."""
    scales = quantisation.scales(error, width, order)
    changed = np.add.reduceat(np.diff(reading) != 0.0, np.arange(scales.size) * min(width, error.size - 1)) > 0
    return np.where(changed, scales, np.median(scales[changed])) if np.any(changed) else scales


def _of_channel(channel: _Channel, faults: list[DataFault]) -> _Bools:
    """Flags of a channel, shape (N,); its faults are added."""
    if np.ptp(channel.reading) == 0.0:
        t = channel.t
        where = f"dead: {channel.reading[0]:.6g} from {t[0]:.1f} s to {t[-1]:.1f} s"
        faults.append(DataFault("stuck", (channel.name,), 1, where, float(t[-1] - t[0])))
        return np.ones(t.size, np.bool_)
    off, sd = _off(channel)
    spikes = _spikes(channel, off, sd)
    saturated = _saturated(channel, spikes, faults)
    # what is left of a saturated stretch has another distribution than noise
    share = (
        np.convolve(saturated, np.full(2 * _NEAR + 1, 1.0 / (2 * _NEAR + 1)), "same") if saturated.any() else saturated
    )
    spikes &= share < _SATURATED
    _say_spikes(channel, spikes, np.abs(off[spikes]), sd[spikes], faults)
    stuck = _stuck(channel, saturated, faults)
    _coarse(channel, stuck, faults)
    return np.asarray(spikes | saturated | stuck)


# ----------------------------------------------------------------------------------------------------------- spikes


def _off(channel: _Channel) -> tuple[Array, Array]:
    """Distance of each reading from the median of it and its neighbours, and the noise there; each of shape (N,)."""
    e = channel.error
    off = np.zeros(e.size)
    left, middle, right = e[:-2], e[1:-1], e[2:]
    off[1:-1] = middle - np.clip(middle, np.minimum(left, right), np.maximum(left, right))
    s = channel.scales
    around = np.maximum(s, np.maximum(np.append(s[1:], 0.0), np.append(0.0, s[:-1])))
    return off, quantisation.spread(np.maximum(around, np.median(s)), channel.width, e.size)


def _spikes(channel: _Channel, off: Array, sd: Array) -> _Bools:
    """Isolated readings that are off.

    For white noise P(∣d∣ > h σ) ≈ 0.034 exp(-h²/3), d the distance from the median of three; 7 is enough up to half a
    million readings. Correlated noise has less of it.
    """
    most = max(SPIKE, float(np.sqrt(3.0 * np.log(0.034 * 6.0 * off.size / _FALSE))))
    spikes = np.abs(off) > np.maximum(most * sd, 2.5 * channel.lattice)
    spikes[spikes] = [_is_isolated(channel, int(k), abs(off[k]) / most) for k in np.flatnonzero(spikes)]
    return np.asarray(spikes)


def _say_spikes(channel: _Channel, spikes: _Bools, sizes: Array, sd: Array, faults: list[DataFault]) -> None:
    if sizes.size:
        where = _times(channel.t[spikes]) + _powers(sizes, sd, channel.lsb or channel.lattice)
        faults.append(DataFault("spikes", (channel.name,), sizes.size, where, float(np.median(sizes))))


def _is_isolated(channel: _Channel, k: int, sd: float) -> bool:
    """Whether readings around reading k change by less than noise of `sd` does: a knock rings, a spike does not.

    Where the input is known only the median change counts, for other spikes may be near. Where it is not, a hand may
    have done it: each change counts, and a knock is felt along other axes too.
    """
    near = np.abs(_changes_beside(channel.error, k))
    if not near.size:
        return True
    if not np.isnan(channel.perfect[k % channel.perfect.size]):
        return bool(np.median(near) / 0.6745 < np.sqrt(2.0) * sd)
    return bool(_rms(near) < np.sqrt(2.0) * sd) and not any(_is_knocked(x, k) for x in channel.others.T)


def _is_knocked(x: Array, k: int) -> bool:
    """Whether a channel beside moves at reading k, or next to it, by more than its noise does."""
    change = np.abs(np.diff(x[max(0, k - 2) : k + 3]))
    return bool(np.max(change) > _FELT * _rms(_changes_beside(x, k)))


def _changes_beside(x: Array, k: int) -> Array:
    """Differences of the readings before reading k, and of those after it."""
    return np.concatenate([np.diff(x[max(0, k - _NEAR) : k]), np.diff(x[k + 1 : k + 1 + _NEAR])])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _powers(sizes: Array, sd: Array, count: float) -> str:
    """A word on spikes that are all powers of two of a count, where that is not by chance."""
    if count <= 0.0:
        return ""
    power = np.rint(np.log2(sizes / count))
    near = 3.0 * np.sqrt(1.5) * sd
    if np.any(power < 1) or np.any(np.abs(sizes - 2.0**power * count) > near):
        return ""
    # of sizes spread evenly over an octave
    chance = np.minimum(1.0, 2.0 * near / (2.0**power * count * np.log(2.0)))
    if np.sum(np.log(chance)) > np.log(_CHANCE_OF_POWERS):
        return ""
    bits = sorted({int(p) for p in power})
    return f"; bit flip: {', '.join(f'2^{bit}' for bit in bits)} counts"


# ------------------------------------------------------------------------------------------------------- saturation


def _saturated(channel: _Channel, spikes: _Bools, faults: list[DataFault]) -> _Bools:
    out = np.zeros(spikes.size, np.bool_)
    for side in (1.0, -1.0):
        at = _at_extreme(channel, side, spikes)
        if np.any(at):
            limit = float(channel.reading[np.argmax(at)])
            where = f"at {limit:.6g}: " + _stretches(channel.t, _runs_of(at))
            faults.append(DataFault("saturation", (channel.name,), int(np.sum(at)), where, limit))
            out |= at
    return out


def _at_extreme(channel: _Channel, side: float, spikes: _Bools) -> _Bools:
    """Readings that piled up at the largest value there is (`side` 1) or the smallest (-1); none if they did not.

    A smooth distribution has about as many readings at its extreme value as at those just inside it, which are counted
    over half a standard deviation of the noise.
    """
    x = side * channel.reading
    extreme = float(np.max(x[~spikes]))
    tolerance = max(0.25 * channel.lattice, 1e-9 * abs(extreme))
    at = (np.abs(x - extreme) <= tolerance) & ~spikes
    count, none = int(np.sum(at)), np.zeros(at.size, np.bool_)
    if count < _LEAST_PILE:
        return none
    noise, beyond = float(np.median(channel.scales)), _beyond(channel, side, extreme)
    if 2.0 * channel.lattice > noise:
        # a few values make up all the noise, and the last of them may hold much of it: only a known input tells
        least = 5.0 * noise + 3.0 * channel.lattice + 0.02 * abs(extreme)
        return at & (beyond > least) if np.sum(at & (beyond > least)) >= _LEAST_PILE else none
    inside = int(np.sum((x < extreme - tolerance) & (x > extreme - 0.5 * noise - tolerance)))
    expected = _PILE * inside * channel.lattice / (0.5 * noise) + 0.1
    if special.pdtrc(count - 1, expected) > _FALSE / 1000.0:
        return none
    if len(_runs_of(at)) <= 2 and not np.median(beyond[at]) > -noise:
        return none  # held, and nothing says that there was more to show
    return at


def _beyond(channel: _Channel, side: float, extreme: float) -> Array:
    """By how much the reading to expect is beyond the extreme one, shape (N,); NaN where unknown."""
    known = ~np.isnan(channel.perfect)
    if not np.any(known):
        return np.full(channel.t.size, np.nan)
    bias = float(np.median(channel.error[np.broadcast_to(known, channel.t.shape)]))
    return np.asarray(np.broadcast_to(side * (channel.perfect + bias) - extreme, channel.t.shape))


# ------------------------------------------------------------------------------------------------------------ stuck


def _stuck(channel: _Channel, saturated: _Bools, faults: list[DataFault]) -> _Bools:
    """Readings that repeat beyond chance.

    Whatever came before, normal noise of innovation σ falls into one step of the lattice with at most
    q = erf(lattice / (2 √2 σ)). N q^L < 1e-3 gives L; twice that, and three times the usual, are stuck.
    """
    runs = _runs(channel.reading)
    length = runs[:, 1] - runs[:, 0]
    usual = float(np.quantile(length, 0.99))
    q = _held(channel)
    chance = np.log(channel.t.size / _FALSE) / -np.log(q)
    least = max(float(_LEAST_RUN), _RUN_MARGIN * chance, _OVER_USUAL * usual)
    runs = runs[(length > least) & ~saturated[runs[:, 0]]]
    out = np.zeros(channel.t.size, np.bool_)
    if len(runs):
        for first, end in runs:
            out[first:end] = True
        longest = float(np.max(channel.t[runs[:, 1] - 1] - channel.t[runs[:, 0]]))
        faults.append(DataFault("stuck", (channel.name,), len(runs), _stretches(channel.t, runs), longest))
    return out


def _held(channel: _Channel) -> float:
    """Most of the noise that one value of the lattice can hold, q; of the quietest tenth of the run."""
    e, width = channel.error, channel.width
    # smooth noise has less in its second differences: the smaller of both is not above the innovation
    first = channel.scales[channel.scales > 0.0]
    second = _alive(e, channel.reading, width, 2)
    second = second[second > 0.0]
    if not first.size or not second.size or channel.lattice == 0.0:
        return 0.05
    sd = min(float(np.quantile(first, 0.1)), float(np.quantile(second, 0.1)))
    noise = np.sqrt(max(sd**2 - channel.lattice**2 / 12.0, (0.15 * channel.lattice) ** 2))
    return float(np.clip(special.erf(channel.lattice / (2.0 * np.sqrt(2.0) * noise)), 0.05, 1.0 - 1e-9))


# ----------------------------------------------------------------------------------------------------------- coarse


def _coarse(channel: _Channel, stuck: _Bools, faults: list[DataFault]) -> None:
    if channel.lattice == 0.0 or np.count_nonzero(np.diff(channel.reading)) < _LEAST_CHANGES:
        return
    scales = quantisation.scales(channel.error, channel.width)
    held = quantisation.spread(np.arange(scales.size, dtype=float), channel.width, stuck.size)[stuck].astype(int)
    noise = float(np.median(np.delete(scales, np.unique(held)) if np.unique(held).size < scales.size else scales))
    if channel.lsb is not None:
        is_coarse, against = channel.lattice > COARSE * channel.lsb, f"{channel.lattice / channel.lsb:.1f} counts"
    else:
        # what is seen has the step's own noise in it, lattice²/12
        is_coarse = noise**2 < channel.lattice**2 * (1.0 / COARSE**2 + 1.0 / 12.0)
        against = f"{channel.lattice / noise:.1f} times the noise" if noise > 0.0 else "no noise between its steps"
    if is_coarse:
        where = f"steps of {channel.lattice:.4g}, {against}"
        faults.append(DataFault("coarse", (channel.name,), channel.t.size, where, channel.lattice))


# ----------------------------------------------------------------------------------------------------------- stamps


def _of_stamps(t: Array, stamps: StampQuality) -> list[DataFault]:
    faults = []
    if stamps.gaps.size:
        longest = float(np.max(t[stamps.gaps + 1] - t[stamps.gaps]))
        lost = int(np.sum(np.rint((t[stamps.gaps + 1] - t[stamps.gaps]) / stamps.period) - 1.0))
        where = f"{_times(t[stamps.gaps])}; about {lost} readings lost"
        faults.append(DataFault("dropout", CHANNELS, stamps.gaps.size, where, longest))
    if stamps.is_off:
        where = f"stamps off by {1e3 * stamps.jitter:.3g} ms"
        if stamps.bursts:
            median = float(np.median(np.diff(t)))
            where += f", in bursts: median step {1e3 * median:.3g} ms, mean {1e3 * stamps.period:.3g} ms"
        faults.append(DataFault("jitter", CHANNELS, stamps.off.size, where, stamps.jitter))
    return faults


# ------------------------------------------------------------------------------------------------------------ words


def _runs(x: Array) -> NDArray[np.intp]:
    """First and end of each run of equal values, shape (M, 2)."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1, [x.size]])
    return np.stack([edges[:-1], edges[1:]], axis=1)


def _runs_of(flags: _Bools) -> NDArray[np.intp]:
    """First and end of each run of set flags, shape (M, 2)."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False))
    return edges.reshape(-1, 2)


def _times(t: Array) -> str:
    return _listed([f"{at:.1f} s" for at in t[: _SHOWN + 1]], t.size)


def _stretches(t: Array, runs: NDArray[np.intp]) -> str:
    def words(first: int, end: int) -> str:
        return f"{t[first]:.1f} s" if t[end - 1] - t[first] < 0.1 else f"{t[first]:.1f}-{t[end - 1]:.1f} s"

    return _listed([words(int(first), int(end)) for first, end in runs[: _SHOWN + 1]], len(runs))


def _listed(words: list[str], count: int) -> str:
    if count <= _SHOWN:
        return ", ".join(words)
    return f"{', '.join(words[: _SHOWN - 1])} and {count - _SHOWN + 1} more"
