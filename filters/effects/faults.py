"""Integrity of one run at the full rate: readings and stamps that are not what the sensor felt (29-33).

`find` looks at each channel by itself, at the instrument's own readings, and says which of them must not be used. What
it leaves out: what to do about blocks with such readings, and why it happened.

Every threshold is a bound on what noise does by chance: noise of any colour, for what is compared is one reading with
its neighbours, against the differences seen in the 2 s around it and in the whole run.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from filters.channels import CHANNELS, error_unit
from filters.effects import quantisation, time_stamps
from filters.effects.fault_records import (
    DEAD,
    FALSE,
    ChannelReadings,
    DataFault,
    Flags,
    edges_of_equal,
    noise_scales,
    poisson_tail,
    runs_of,
    stretches_in_words,
    times_in_words,
)
from filters.effects.time_stamps import StampQuality
from filters.types import Array

COARSE = 3.5
"""Times the nominal count; or times the noise, where that is not known. A mean follows the input to 2 % of the step at
2.6 times and to 6 % at 3.5 times: quantisation is then no noise any more."""

_SATURATED = 0.2  # share of the readings around that is
_LONGEST = 10_000  # readings; longer runs of equal ones are counted as this long
_AT_ONCE = 1 << 18
_LEAST_RUN = 5  # readings alike
_RUN_MARGIN = 2.0
_OVER_USUAL = 3.0  # times the length that all but one in a hundred repetitions have
_LEAST_CHANGES = 10
_LEAST_SHARE = 0.02  # of the noise: smaller steps than this matter to nothing


def find(
    t: Array, reading: Array, perfect: Array, lsb: Array | None, of: int | None = None
) -> tuple[Flags, list[DataFault]]:
    """Faults of one run, and the readings that must not be used.

    spikes      ∣e - median(e₋, e, e₊)∣ > 7 σ, and more than two and a half steps of the lattice, e = reading - perfect
    stuck       more equal readings in a row than q^L allows, q the most that a step of the lattice holds of the noise
    saturation  more readings at the extreme value than the values just inside let expect
    coarse      readings a step apart that is above 3.5 counts, or where counts are unknown, 3.5 σ
    dropout     a step between stamps above max(2.5 T, T + 8 jitter)
    jitter      stamps off by more than 2 % of the period, or in bursts

    `t`: stamps, s, shape (N,).
    `reading`: rates (rad/s) and accelerations (m/s²) as the instrument shows them, its axes and sign, shape (N, 6).
    `perfect`: what a unit without errors would show, shape (N, 6) or (1, 6); NaN where unknown.
    `lsb`: size of a count, rad/s and m/s², shape (6,).
    `of`: readings of the whole run, if these are a piece of it: chance has had as many tries.
    Returns `flagged`, spikes, stuck and saturated readings, shape (N, 6).
    Raises ValueError if shapes do not fit together.
    """
    if reading.shape != (t.size, len(CHANNELS)) or perfect.shape not in (reading.shape, (1, len(CHANNELS))):
        raise ValueError(f"`reading` has shape {reading.shape} and `perfect` {perfect.shape} for {t.size} stamps")
    flagged = np.zeros(reading.shape, np.bool_)
    faults: list[DataFault] = []
    if t.size < quantisation.LEAST_WINDOW:
        return flagged, faults
    stamps = time_stamps.analyse(t)
    channels = [_channel(c, t, reading, perfect, lsb, stamps.period, of or t.size) for c in range(len(CHANNELS))]
    for c, channel in enumerate(channels):
        triad = channels[3 * (c // 3) : 3 * (c // 3) + 3]
        bad, own = _of_channel(channel, [other.lattice for other in triad if other is not channel])
        if bad.any():
            flagged[:, c] = bad
        faults += own
    return flagged, faults + _of_stamps(t, stamps)


def _channel(
    c: int, t: Array, reading: Array, perfect: Array, lsb: Array | None, period: float, of: int
) -> ChannelReadings:
    x = np.ascontiguousarray(reading[:, c])
    known = np.ascontiguousarray(perfect[:, c])
    error = np.where(np.isnan(known), x, x - known)
    count = None if lsb is None else float(lsb[c])
    width = quantisation.window(1.0 / period if period > 0.0 else 1.0, t.size - 1)
    lattice = quantisation.lattice(x, count)
    first, second = (reading[:, 3 * (c // 3) + (c + k) % 3] for k in (1, 2))
    return ChannelReadings(
        name=CHANNELS[c],
        t=t,
        reading=x,
        error=error,
        perfect=known,
        lsb=count,
        lattice=lattice,
        others=(first, second),
        width=width,
        scales=noise_scales(error, x, width),
        of=of,
    )


def _of_channel(channel: ChannelReadings, beside: Sequence[float]) -> tuple[Flags, list[DataFault]]:
    """Flags of a channel, shape (N,), and its faults; `beside`: lattices of the other two of its kind."""
    if np.ptp(channel.reading) == 0.0:
        t = channel.t
        where = f"{DEAD}{_with_unit(channel, channel.reading[0], 6)} from {t[0]:.1f} s to {t[-1]:.1f} s"
        return np.ones(t.size, np.bool_), [DataFault("stuck", (channel.name,), 1, where, float(t[-1] - t[0]))]
    rows, off, sd = _isolated(channel)
    isolated = np.zeros(channel.t.size, np.bool_)
    isolated[rows] = True
    saturated, faults = _saturated(channel, isolated)
    # what is left of a saturated stretch has another distribution than noise
    width = 2 * _NEAR + 1
    share = np.convolve(saturated, np.full(width, 1.0 / width), "same") if saturated.any() else saturated
    isolated &= share < _SATURATED
    kept = isolated[rows]
    faults += _spikes_told(channel, isolated, off[kept], sd[kept])
    stuck, more = _stuck(channel, saturated)
    return np.asarray(isolated | saturated | stuck), [*faults, *more, *_coarse(channel, stuck, beside)]


def _with_unit(channel: ChannelReadings, value: float, digits: int = 4) -> str:
    """A reading of a channel in words: SI value as deg/s or mg."""
    unit, size = error_unit(CHANNELS.index(channel.name))
    return f"{value / size:.{digits}g} {unit}"


# ------------------------------------------------------------------------------------------------------------ stuck


def _stuck(channel: ChannelReadings, saturated: Flags) -> tuple[Flags, list[DataFault]]:
    """Readings that repeat beyond chance, shape (N,), and what is told of them.

    Whatever came before, normal noise of innovation σ falls into one step of the lattice with at most
    q = erf(lattice / (2 √2 σ)). N q^L < 1e-3 gives L; twice that, and three times the usual, are stuck.
    """
    # first, since of a day of samples each of what follows is large
    q = _held(channel)
    edges = edges_of_equal(channel.reading)
    length = np.subtract(edges[1:], edges[:-1], dtype=np.int32, casting="unsafe")
    usual = _usual_length(length)
    chance = np.log(channel.of / FALSE) / -np.log(q)
    least = max(float(_LEAST_RUN), _RUN_MARGIN * chance, _OVER_USUAL * usual)
    long = np.flatnonzero(length > least)
    runs = np.stack([edges[long], edges[long + 1]], axis=1)
    runs = runs[~saturated[runs[:, 0]]]
    out = np.zeros(channel.t.size, np.bool_)
    for first, end in runs:
        out[first:end] = True
    if not len(runs):
        return out, []
    longest = float(np.max(channel.t[runs[:, 1] - 1] - channel.t[runs[:, 0]]))
    return out, [DataFault("stuck", (channel.name,), len(runs), stretches_in_words(channel.t, runs), longest)]


def _usual_length(length: NDArray[np.int32]) -> float:
    """What 99 % of the runs of equal readings do not exceed; counted in parts, since a day has millions."""
    counts = np.zeros(_LONGEST + 1, np.int64)
    for first in range(0, length.size, _AT_ONCE):
        counts += np.bincount(np.minimum(length[first : first + _AT_ONCE], _LONGEST), minlength=counts.size)
    return float(np.searchsorted(np.cumsum(counts), 0.99 * (length.size - 1), side="right"))


def _held(channel: ChannelReadings) -> float:
    """Most of the noise that one value of the lattice can hold, q; of the quietest tenth of the run."""
    e, width = channel.error, channel.width
    # smooth noise has less in its second differences: the smaller of both is not above the innovation
    first = channel.scales[channel.scales > 0.0]
    second = noise_scales(e, channel.reading, width, 2)
    second = second[second > 0.0]
    if not first.size or not second.size or channel.lattice == 0.0:
        return 0.05
    sd = min(float(np.quantile(first, 0.1)), float(np.quantile(second, 0.1)))
    noise = np.sqrt(max(sd**2 - channel.lattice**2 / 12.0, (0.15 * channel.lattice) ** 2))
    return float(np.clip(math.erf(channel.lattice / (2.0 * math.sqrt(2.0) * noise)), 0.05, 1.0 - 1e-9))


# ----------------------------------------------------------------------------------------------------------- coarse


def _coarse(channel: ChannelReadings, stuck: Flags, beside: Sequence[float]) -> list[DataFault]:
    """Steps of readings that are far above a count.

    Where the size of a count is not known: above those of both channels beside it, which are made alike, or so large
    that quantisation is no noise any more.
    """
    if channel.lattice == 0.0 or np.count_nonzero(channel.reading[1:] != channel.reading[:-1]) < _LEAST_CHANGES:
        return []
    scales = quantisation.scales(channel.error, channel.width)
    held = np.unique(np.minimum(np.flatnonzero(stuck) // channel.width, scales.size - 1))
    noise = float(np.median(np.delete(scales, held) if held.size < scales.size else scales))
    if channel.lsb is not None:
        is_coarse, against = channel.lattice > COARSE * channel.lsb, f"{channel.lattice / channel.lsb:.1f} counts"
    elif channel.lattice > COARSE * max(beside) and _LEAST_SHARE * noise < channel.lattice:
        is_coarse = True
        against = "while the other two of its kind show " + (
            _with_unit(channel, max(beside)) if max(beside) else "none"
        )
    else:
        # what is seen has the step's own noise in it, lattice²/12
        is_coarse = noise**2 < channel.lattice**2 * (1.0 / COARSE**2 + 1.0 / 12.0)
        against = f"{channel.lattice / noise:.1f} times the noise" if noise > 0.0 else "no noise between its steps"
    if not is_coarse:
        return []
    where = f"steps of {_with_unit(channel, channel.lattice)}, {against}"
    return [DataFault("coarse", (channel.name,), channel.t.size, where, channel.lattice)]


# ----------------------------------------------------------------------------------------------------------- stamps


def _of_stamps(t: Array, stamps: StampQuality) -> list[DataFault]:
    faults = []
    if stamps.gaps.size:
        longest = float(np.max(t[stamps.gaps + 1] - t[stamps.gaps]))
        lost = int(np.sum(np.rint((t[stamps.gaps + 1] - t[stamps.gaps]) / stamps.period) - 1.0))
        where = f"{times_in_words(t[stamps.gaps])}; about {lost} readings lost"
        faults.append(DataFault("dropout", CHANNELS, stamps.gaps.size, where, longest))
    if stamps.is_off:
        where = f"stamps off by {1e3 * stamps.jitter:.3g} ms"
        if stamps.bursts:
            median = float(np.median(np.diff(t)))
            where += f", in bursts: median step {1e3 * median:.3g} ms, mean {1e3 * stamps.period:.3g} ms"
        faults.append(DataFault("jitter", CHANNELS, stamps.off.size, where, stamps.jitter))
    return faults


# ------------------------------------------------------------------------------------------------------ saturation
# Readings that piled up at the largest value that there is, or at the smallest.

_LEAST_PILE = 5
_PACE = 3  # readings before a limit that say how fast it was run into
_PILE = 3.0  # times what a smooth distribution has


def _saturated(channel: ChannelReadings, spikes: Flags) -> tuple[Flags, list[DataFault]]:
    """Readings at a limit, shape (N,), and what is told of them; spikes do not count."""
    out, faults = np.zeros(spikes.size, np.bool_), []
    for side in (1.0, -1.0):
        at = _at_extreme(channel, side, spikes)
        if np.any(at):
            limit = float(channel.reading[np.argmax(at)])
            where = f"at {_with_unit(channel, limit, 6)}: " + stretches_in_words(channel.t, runs_of(at))
            faults.append(DataFault("saturation", (channel.name,), int(np.sum(at)), where, limit))
            out |= at
    return out, faults


def _at_extreme(channel: ChannelReadings, side: float, spikes: Flags) -> Flags:
    """Readings that piled up at the largest value there is (`side` 1) or the smallest (-1); none if they did not.

    A smooth distribution has about as many readings at its extreme value as at those just inside it, which are counted
    over half a standard deviation of the noise.
    """
    extreme = _extreme(channel.reading, side, spikes)
    tolerance = max(0.25 * channel.lattice, 1e-9 * abs(extreme))
    at = np.zeros(spikes.size, np.bool_)
    noise = float(np.median(channel.scales))
    inside = 0
    for rows in _parts(spikes.size):
        x = side * channel.reading[rows]
        at[rows] = (np.abs(x - extreme) <= tolerance) & ~spikes[rows]
        inside += int(np.sum((x < extreme - tolerance) & (x > extreme - 0.5 * noise - tolerance)))
    count, none = int(np.sum(at)), np.zeros(at.size, np.bool_)
    if count < _LEAST_PILE:
        return none
    beyond = _beyond(channel, side, extreme, at)
    if 2.0 * channel.lattice > noise:
        # a few values make up all the noise, and the last of them may hold much of it: only a known input tells
        least = 5.0 * noise + 3.0 * channel.lattice + 0.02 * abs(extreme)
        if not _broken_off(channel, side, extreme, at):
            at[at] = beyond > least
        return at if np.sum(at) >= _LEAST_PILE else none
    expected = _PILE * inside * channel.lattice / (0.5 * noise) + 0.1
    if poisson_tail(count, expected) > FALSE / 1000.0 * channel.t.size / channel.of:
        return none
    if len(runs_of(at)) <= 2 and not (np.median(beyond) > -noise or _broken_off(channel, side, extreme, at)):
        return none  # held, and nothing says that there was more to show
    return at


def _extreme(reading: Array, side: float, spikes: Flags) -> float:
    """The largest reading that is no spike, or the smallest, negative, on side -1."""
    if side > 0.0:
        return float(np.max(reading, where=~spikes, initial=-np.inf))
    return -float(np.min(reading, where=~spikes, initial=np.inf))


def _parts(count: int) -> Iterator[slice]:
    """Rows in parts, so that no copy of all is made."""
    return (slice(first, first + _AT_ONCE) for first in range(0, count, _AT_ONCE))


def _beyond(channel: ChannelReadings, side: float, extreme: float, at: Flags) -> Array:
    """By how much the readings to expect are beyond the extreme one, of those `at` it; NaN where unknown."""
    known = ~np.isnan(channel.perfect)
    count = int(np.count_nonzero(at))
    if not np.any(known):
        return np.full(count, np.nan)
    bias = float(np.median(channel.error if known.all() else channel.error[known]))
    expected = channel.perfect[at] if channel.perfect.size == at.size else np.broadcast_to(channel.perfect, (count,))
    return np.asarray(side * (expected + bias) - extreme)


def _broken_off(channel: ChannelReadings, side: float, extreme: float, at: Flags) -> bool:
    """Whether readings of an unknown input run into the limit at a pace that would have taken them beyond it."""
    if not np.isnan(channel.perfect).all():
        return False
    first = np.array([a for a, end in runs_of(at).tolist() if a >= _PACE and end - a > 1], np.int64)
    last = side * channel.reading[first - 1]
    pace = (last - side * channel.reading[first - _PACE]) / (_PACE - 1)
    noise = _FELT * float(np.median(channel.scales)) + 2.0 * channel.lattice
    return bool((last + 2.0 * pace > extreme + noise).any())  # where the second reading at the limit was to be


# ---------------------------------------------------------------------------------------------------------- spikes
# Isolated readings that are off, told from knocks, which ring and are felt along other axes too.

SPIKE = 7.0  # standard deviations of one reading, from the median of it and its two neighbours
_FELT = 3.0  # standard deviations
_NEAR = 8  # readings on each side of a spike that are quiet
_CHANCE_OF_POWERS = 0.05


def _isolated(channel: ChannelReadings) -> tuple[NDArray[np.intp], Array, Array]:
    """Readings that are off by themselves: their numbers, by how much, and the noise there; shape (spikes,) each.

    What counts is the distance of a reading from the median of it and its neighbours. For white noise
    P(∣d∣ > h σ) ≈ 0.034 exp(-h²/3), d that distance; 7 is enough up to half a million readings. Correlated noise has
    less of it.
    """
    count = channel.error.size
    most = max(SPIKE, float(np.sqrt(3.0 * np.log(0.034 * 6.0 * channel.of / FALSE))))
    s = channel.scales
    around = np.maximum(s, np.maximum(np.append(s[1:], 0.0), np.append(0.0, s[:-1])))
    around = np.maximum(around, np.median(s))
    found = []
    for first in range(1, count - 1, _AT_ONCE):
        last = min(first + _AT_ONCE, count - 1)
        off = _off_neighbours(channel.error[first - 1 : last + 1])
        sd = quantisation.spread(around, channel.width, np.arange(first, last))
        rows = np.flatnonzero(off > np.maximum(most * sd, 2.5 * channel.lattice))
        alone = np.array([_is_isolated(channel, first + k, float(off[k]) / most) for k in rows.tolist()], np.bool_)
        found.append((first + rows[alone], off[rows][alone], sd[rows][alone]))
    numbers, sizes, sds = (np.concatenate(own) for own in zip(*found, strict=True))
    return numbers, sizes, sds


def _off_neighbours(e: Array) -> Array:
    """Distance of each reading but the first and the last from the median of it and its neighbours."""
    left, middle, right = e[:-2], e[1:-1], e[2:]
    return np.abs(middle - np.clip(middle, np.minimum(left, right), np.maximum(left, right)))


def _spikes_told(channel: ChannelReadings, spikes: Flags, sizes: Array, sd: Array) -> list[DataFault]:
    """What is told of a channel's spikes.

    `spikes`: which readings they are, shape (N,).
    `sizes`, `sd`: distance of each spike from its neighbours and the noise there, SI, shape (spikes,).
    """
    if not sizes.size:
        return []
    where = times_in_words(channel.t[spikes]) + _powers(sizes, sd, channel.lsb or channel.lattice)
    return [DataFault("spikes", (channel.name,), sizes.size, where, float(np.median(sizes)))]


def _is_isolated(channel: ChannelReadings, k: int, sd: float) -> bool:
    """Whether readings around reading k change by less than noise of `sd` does: a knock rings, a spike does not.

    Where the input is known only the median change counts, for other spikes may be near. Where it is not, a hand may
    have done it: each change counts, and a knock is felt along other axes too.
    """
    near = np.abs(_changes_beside(channel.error, k))
    if not near.size:
        return True
    if not np.isnan(channel.perfect[k % channel.perfect.size]):
        return bool(np.median(near) / 0.6745 < np.sqrt(2.0) * sd)
    return bool(_rms(near) < np.sqrt(2.0) * sd) and not any(_is_knocked(x, k) for x in channel.others)


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
