"""What the drifts of several channels have in common: which channels, how much of each, its course in time.

Drifts of two channels that have nothing in common look alike often enough in time: a random walk is one long wave. So
they are compared frequency by frequency, where they are independent. The differences of neighbouring rows (of a walk:
white) are transformed under Hann's window, each frequency is divided by the power around it, and those count most where
both channels have more than their white noise. What the white noises themselves have in common is taken off.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special
from scipy.signal import windows

from filters.tracing.common_rows import Rows, filled
from filters.types import Array

_FALSE = 1e-3  # probability of one pair or more in a trace of channels that have nothing in common
_LEAST_COHERENCE = 0.1
_AROUND = 4  # frequencies to either side, or a third of the frequency, whose mean is the power around one
_FIRST = 2  # a straight line leaks into the first
_WORTH = 1.94  # neighbouring frequencies under Hann's window are so many times fewer
_WHITE_FROM = 0.125  # of the rows' rate: above it white noise is compared
_ITERATIONS = 50

_Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class CommonDrift:
    """A drift that channels share."""

    channels: tuple[int, ...]  # the leading one first
    correlation: Array  # of each channel's drift with what is shared, signed, shape (k,)
    correlation_sd: Array  # their standard deviations, shape (k,)
    size: Array  # standard deviation of each channel's drift about the mean of a stretch, SI, shape (k,)
    # the shared course, in SI of the leading channel, is their sum over the channels' residuals, shape (k,)
    weights: Array
    p: float  # probability of as much by chance, over the whole trace

    @property
    def coherence(self) -> float:
        """Mean squared correlation of the channels with what is shared."""
        return float(np.mean(self.correlation**2))


@dataclass(frozen=True, slots=True)
class _Spectra:
    """All stretches' transforms, one after the other."""

    X: _Complex  # of differences, over the root of the power around, shape (n, 6)
    share: Array  # of that power which white noise does not explain, 0 to 1, shape (n, 6)
    # power of the rows themselves that white noise does not explain, SI, shape (n, 6); it sums to the variance
    drift: Array
    over: Array  # power over that of white noise, shape (n, 6)
    cycles: Array  # frequency, cycles a row, shape (n,)

    @property
    def fast(self) -> NDArray[np.bool_]:
        """Where white noises are compared, shape (n,)."""
        return self.cycles > _WHITE_FROM


def common_drifts(rows: Rows) -> list[CommonDrift]:
    """Drifts that channels share, the surest first.

    `rows`: of all runs, cut at common steps.
    """
    spectra = _spectra(rows)
    if spectra is None:
        return []
    drifting = [c for c in rows.channels if _has_excess(spectra, c)]
    correlation, freedom, chance = _compared(spectra, drifting)
    tests = max(1, len(rows.channels) * (len(rows.channels) - 1) // 2)
    sure = (chance * tests < _FALSE) & (correlation**2 > _LEAST_COHERENCE)
    found = []
    for group in _groups(sure):
        inner = correlation[np.ix_(group, group)]
        loading = _loadings(inner)
        p = float(chance[np.ix_(group, group)][np.triu_indices(len(group), 1)].min()) * tests
        found.append(_drift(rows, spectra, [drifting[k] for k in group], loading, freedom[np.ix_(group, group)], p))
    return sorted(found, key=lambda drift: drift.p)


def _spectra(rows: Rows) -> _Spectra | None:
    """Transforms of all stretches that are long enough."""
    parts = [part for s in rows.stretches if (part := _of_stretch(rows, rows.of(s))) is not None]
    if not parts:
        return None
    total = sum(part.X.shape[0] for part in parts)
    # each stretch's power is of its own variance; of all together the mean counts
    drift = [part.drift * part.X.shape[0] / total for part in parts]
    return _Spectra(
        np.concatenate([part.X for part in parts]),
        np.concatenate([part.share for part in parts]),
        np.concatenate(drift),
        np.concatenate([part.over for part in parts]),
        np.concatenate([part.cycles for part in parts]),
    )


def _of_stretch(rows: Rows, x: Array) -> _Spectra | None:
    differences = np.diff(filled(x, 0.9), axis=0)
    n = len(differences)
    window = windows.hann(n, sym=False)
    k = np.arange(_FIRST, (n + 1) // 2)
    if k.size < 4 * _AROUND:
        return None
    centred = (differences - differences.mean(axis=0)) * window[:, None]
    raw = fft.rfft(centred, axis=0)[k] / np.sqrt(np.sum(window**2))
    power = np.abs(raw) ** 2
    around = np.stack([_around(power[:, c]) for c in range(6)], axis=1)
    white = np.nan_to_num(rows.white)
    step = 4.0 * np.sin(np.pi * k / n)[:, None] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        X = np.where(around > 0.0, raw / np.sqrt(around), 0.0)
        share = np.where(around > 0.0, 1.0 - step * white / around, 0.0)
        over = np.where(white > 0.0, power / (step * white), 0.0)
    share = np.clip(share, 0.0, 1.0)
    # by the same share as correlation is: what all frequencies have more than white noise, less what they have less of
    # it, is nothing at all where the noise is not quite as white as it is taken for
    drift = share * power / step * 2.0 / n
    return _Spectra(X, share, drift, over, k / n)


def _around(power: Array) -> Array:
    """Mean over a frequency and its neighbours, more of them the higher it is."""
    sums = np.concatenate([[0.0], np.cumsum(power)])
    k = np.arange(power.size)
    side = np.maximum(_AROUND, k // 3)
    low, high = np.maximum(0, k - side), np.minimum(power.size, k + side + 1)
    return np.asarray((sums[high] - sums[low]) / (high - low))


def _has_excess(spectra: _Spectra, channel: int) -> bool:
    """Whether a channel has more power at its lowest frequencies, up to any, than its white noise."""
    over = spectra.over[np.argsort(spectra.cycles, kind="stable"), channel]
    count = 1 << np.arange(2, max(3, int(np.log2(max(1, over.size)))))
    sums = np.cumsum(over)[np.minimum(count, over.size) - 1]
    chance = special.gammaincc(count / _WORTH, sums / _WORTH)
    return bool(np.min(chance) * count.size < _FALSE)


def _compared(spectra: _Spectra, channels: list[int]) -> tuple[Array, Array, Array]:
    """Correlation of the drifts of each two channels, its degrees of freedom, probability by chance; (k, k) each."""
    k = len(channels)
    correlation, freedom, chance = np.eye(k), np.zeros((k, k)), np.ones((k, k))
    for i in range(k):
        for j in range(i + 1, k):
            made = _pair(spectra, channels[i], channels[j])
            for a, b in ((i, j), (j, i)):
                correlation[a, b], freedom[a, b], chance[a, b] = made
    return correlation, freedom, chance


def _pair(spectra: _Spectra, a: int, b: int) -> tuple[float, float, float]:
    product = np.real(spectra.X[:, a] * np.conj(spectra.X[:, b]))
    share = np.sqrt(spectra.share[:, a] * spectra.share[:, b])
    if not np.any(share > 0.0):
        return 0.0, 0.0, 1.0
    white = np.sqrt((1.0 - spectra.share[:, a]) * (1.0 - spectra.share[:, b]))
    weight = np.where(spectra.fast, white, 0.0)
    alike = float(np.sum(weight * product) / max(np.sum(weight * white), 1e-300)) if weight.any() else 0.0
    product = product - alike * white
    power = [np.abs(spectra.X[:, c]) ** 2 for c in (a, b)]
    r = float(np.sum(share * product) / np.sqrt(np.sum(share * power[0]) * np.sum(share * power[1])))
    freedom = 2.0 / _WORTH * float(np.sum(share) ** 2 / np.sum(share**2))
    if freedom < 4.0:
        return 0.0, freedom, 1.0
    r = float(np.clip(r, -1.0 + 1e-12, 1.0 - 1e-12))
    t = abs(r) * np.sqrt((freedom - 2.0) / (1.0 - r**2))
    chance = 2.0 * float(special.stdtr(freedom - 2.0, -t))
    excess = float(np.sum(share * product) / np.sum(share**2))
    return float(np.clip(excess, -1.0, 1.0)), freedom, chance


def _groups(sure: NDArray[np.bool_]) -> list[list[int]]:
    """Channels that are joined by pairs."""
    left, groups = set(range(len(sure))), []
    while left:
        group, edge = set[int](), [left.pop()]
        while edge:
            at = edge.pop()
            group.add(at)
            new = [k for k in sorted(left) if sure[at, k]]
            left -= set(new)
            edge += new
        if len(group) > 1:
            groups.append(sorted(group))
    return groups


def _loadings(correlation: Array) -> Array:
    """Correlation of each channel with the one factor that explains those between them best, shape (k,)."""
    off = correlation - np.diag(np.diag(correlation))
    communality = np.max(np.abs(off), axis=1)
    loading = np.sqrt(communality)
    for _ in range(_ITERATIONS):
        values, vectors = np.linalg.eigh(off + np.diag(communality))
        loading = vectors[:, -1] * np.sqrt(max(values[-1], 0.0))
        communality = np.clip(loading**2, 0.0, 1.0)
    loading = np.clip(loading, -1.0, 1.0)
    return np.asarray(loading * (1.0 if loading[np.argmax(np.abs(loading))] >= 0.0 else -1.0))


def _drift(rows: Rows, spectra: _Spectra, channels: list[int], loading: Array, freedom: Array, p: float) -> CommonDrift:
    size = np.sqrt(spectra.drift[:, channels].sum(axis=0))
    # drift that is a channel's own, for no loading is known better than that, and white noise over the row
    own = size**2 * np.maximum(1.0 - loading**2, 0.02) + rows.white[channels]
    scale = size * loading
    order = np.argsort(-np.abs(loading), kind="stable")
    gain = scale / own
    lead = int(order[0])
    weights = gain / float(gain @ scale) * scale[lead]
    most = np.max(freedom, axis=1)
    sd = (1.0 - loading**2) / np.sqrt(np.maximum(most, 1.0))
    return CommonDrift(
        channels=tuple(channels[k] for k in order.tolist()),
        correlation=loading[order],
        correlation_sd=sd[order],
        size=size[order],
        weights=weights[order],
        p=p,
    )
