"""Integrity of one run at the full rate: readings and stamps that are not what the sensor felt (29-33).

`find` looks at each channel by itself, at the instrument's own readings, and says which of them must not be used. What
it leaves out: what to do about blocks with such readings, and why it happened.

Every threshold is a bound on what noise does by chance: noise of any colour, for what is compared is one reading with
its neighbours, against the differences seen in the 2 s around it and in the whole run.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import special

from filters.channels import CHANNELS
from filters.effects import quantisation, saturation, spikes, time_stamps
from filters.effects.fault_records import (
    FALSE,
    ChannelReadings,
    DataFault,
    Flags,
    edges_of_equal,
    noise_scales,
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


def find(t: Array, reading: Array, perfect: Array, lsb: Array | None) -> tuple[Flags, list[DataFault]]:
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
    for c in range(len(CHANNELS)):
        bad, own = _of_channel(_channel(c, t, reading, perfect, lsb, stamps.period))
        if bad.any():
            flagged[:, c] = bad
        faults += own
    return flagged, faults + _of_stamps(t, stamps)


def _channel(c: int, t: Array, reading: Array, perfect: Array, lsb: Array | None, period: float) -> ChannelReadings:
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
    )


def _of_channel(channel: ChannelReadings) -> tuple[Flags, list[DataFault]]:
    """Flags of a channel, shape (N,), and its faults."""
    if np.ptp(channel.reading) == 0.0:
        t = channel.t
        where = f"dead: {channel.reading[0]:.6g} from {t[0]:.1f} s to {t[-1]:.1f} s"
        return np.ones(t.size, np.bool_), [DataFault("stuck", (channel.name,), 1, where, float(t[-1] - t[0]))]
    rows, off, sd = spikes.isolated(channel)
    isolated = np.zeros(channel.t.size, np.bool_)
    isolated[rows] = True
    saturated, faults = saturation.saturated(channel, isolated)
    # what is left of a saturated stretch has another distribution than noise
    width = 2 * spikes.NEAR + 1
    share = np.convolve(saturated, np.full(width, 1.0 / width), "same") if saturated.any() else saturated
    isolated &= share < _SATURATED
    kept = isolated[rows]
    faults += spikes.faults(channel, isolated, off[kept], sd[kept])
    stuck, more = _stuck(channel, saturated)
    return np.asarray(isolated | saturated | stuck), [*faults, *more, *_coarse(channel, stuck)]


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
    chance = np.log(channel.t.size / FALSE) / -np.log(q)
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
    return float(np.clip(special.erf(channel.lattice / (2.0 * np.sqrt(2.0) * noise)), 0.05, 1.0 - 1e-9))


# ----------------------------------------------------------------------------------------------------------- coarse


def _coarse(channel: ChannelReadings, stuck: Flags) -> list[DataFault]:
    """Whether readings come in steps so large that quantisation is no noise any more."""
    if channel.lattice == 0.0 or np.count_nonzero(channel.reading[1:] != channel.reading[:-1]) < _LEAST_CHANGES:
        return []
    scales = quantisation.scales(channel.error, channel.width)
    held = np.unique(np.minimum(np.flatnonzero(stuck) // channel.width, scales.size - 1))
    noise = float(np.median(np.delete(scales, held) if held.size < scales.size else scales))
    if channel.lsb is not None:
        is_coarse, against = channel.lattice > COARSE * channel.lsb, f"{channel.lattice / channel.lsb:.1f} counts"
    else:
        # what is seen has the step's own noise in it, lattice²/12
        is_coarse = noise**2 < channel.lattice**2 * (1.0 / COARSE**2 + 1.0 / 12.0)
        against = f"{channel.lattice / noise:.1f} times the noise" if noise > 0.0 else "no noise between its steps"
    if not is_coarse:
        return []
    where = f"steps of {channel.lattice:.4g}, {against}"
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
