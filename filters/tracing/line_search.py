"""Lines above 1.6 Hz in what effects leave of runs, and runs without them.

A line is never sought where the motion has power: what effects leave of it is not a line. It is one all the same if it
stays there in stretches without motion.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal import windows

from filters.channels import CHANNELS
from filters.effects import lines, spectra
from filters.effects.lines import SpectralLine
from filters.effects.spectra import Samples
from filters.tracing.residual import residual, residual_of, sensed
from filters.tracing.run import Run
from filters.types import Array

# what errors of the catalogue that nothing selected may leave of the motion, as shares of it
_SHARE = 0.01  # of a rate or a force
_DELAY_S = 0.005  # of a derivative
_LEVER_M = 0.05  # of what turns about another place
_SQUARE = 0.01  # of a square over its greatest value
_AT_REST = np.deg2rad(0.05)
_AFTER_S = 0.5  # from the last motion
_LEAST_S = 8.0
_CHUNK = 1 << 14
_OF_RATE = 0.45  # where differences of a measured attitude have a spectrum that falls off steeply


def lines_of(runs: Sequence[Run], left: Sequence[Run]) -> list[SpectralLine]:
    """Lines in the spectra of some runs together.

    `runs`: which say what the motion is.
    `left`: the same less what effects say of them, in which lines are sought; of runs at rest the same again.
    """
    known = next((list(run.full_rate.lines) for run in runs if run.full_rate is not None), None)
    if known is not None:
        return known
    series = [(run.rate_hz, residual_of(run)) for run in left]
    if all(run.still for run in runs) or not spectra.usable(series):
        return lines.find(series)
    barred = _barred(runs, series)
    measured = any(run.attitude is not None for run in runs)
    # the noise of a measured attitude comes and goes with the motion: a way through it is no line of a gyro
    found = [
        line
        for line in lines.find(series, barred)
        if not (measured and line.wanders and all(name.startswith("g") for name in line.channels))
    ]
    return found + _without_motion(runs, series, barred, found) if barred.any() else found


def without_lines(run: Run, found: Sequence[SpectralLine], said: Array | None = None) -> Run:
    """A run less its lines, which are fitted to what is left of it without `said`, what effects say, shape (N, 6)."""
    if not found or run.full_rate is not None:
        return run
    r = residual(run if said is None else replace(run, reading=run.reading - said))
    less = lines.removed(found, run.rate_hz, r) - r
    return replace(run, reading=run.reading + np.nan_to_num(less))


# --------------------------------------------------------------------------------------------------- band of the motion


def _barred(runs: Sequence[Run], series: Sequence[tuple[float, Samples]]) -> NDArray[np.bool_]:
    """Bins in which what the motion may leave exceeds what a residual stands on, in any run; shape (6, M)."""
    hz = spectra.spacing(spectra.usable(series))
    size = max(round(fs / hz) // 2 + 1 for fs, _ in series)
    out = np.zeros((len(CHANNELS), size), bool)
    for run, (fs, r) in zip(runs, series, strict=True):
        if run.still or r.shape[0] < spectra.LEAST:
            continue
        of_gyros, of_accels = _powers(run, hz)
        for c in range(len(CHANNELS)):
            stood = spectra.spectrum(np.ascontiguousarray(r[:, c]), fs, hz)
            if stood is not None:
                power = of_gyros if c < 3 else of_accels
                n = min(stood.level.size, power.size)
                out[c, :n] |= power[:n] > stood.level[:n]
        if run.attitude is not None:
            out[:3, int(_OF_RATE * fs / hz) :] = True
    return out


def _powers(run: Run, hz: float) -> tuple[Array, Array]:
    """Density of what a motion may leave in gyros and in accelerometers, unit²/Hz, shape (M,) each."""
    x, turning = _motion(run)
    w, f = x[:, :3], x[:, 3:]
    w_dot, f_dot = (np.gradient(v, run.t, axis=0) for v in (w, f))
    square = np.sum(turning**2, axis=1, keepdims=True)
    greatest = max(float(np.sqrt(square.max())), 1e-12)
    gyros = [_SHARE * w, _DELAY_S * w_dot, _SQUARE / greatest * square]
    accels = [_SHARE * f, _DELAY_S * f_dot, _LEVER_M * w_dot, _LEVER_M * square]
    return _density(run, gyros, hz), _density(run, accels, hz)


def _motion(run: Run) -> tuple[Array, Array]:
    """What a perfect unit reads, shape (N, 6), and the rates relative to n, body axes, shape (N, 3)."""
    x, turning = np.empty((run.t.size, 6)), np.empty((run.t.size, 3))
    for first in range(0, run.t.size, _CHUNK):
        rows = slice(first, first + _CHUNK)
        true = sensed(run, rows)
        x[rows], turning[rows] = true.reading, true.turning
    return x, turning


def _density(run: Run, signals: Sequence[Array], hz: float) -> Array:
    total = np.zeros(1)
    for column in (column for signal in signals for column in signal.T):
        made = spectra.density(np.ascontiguousarray(column), run.rate_hz, hz)
        if made is not None:
            total = total + made
    return total


# ------------------------------------------------------------------------------------------------------ without motion


def _without_motion(
    runs: Sequence[Run],
    series: Sequence[tuple[float, Samples]],
    barred: NDArray[np.bool_],
    found: Sequence[SpectralLine],
) -> list[SpectralLine]:
    """Lines in the band of the motion that stretches without motion show."""
    stretches = [
        (number, first, last)
        for number, run in enumerate(runs)
        for first, last in _quiet(run)
        if last - first >= _LEAST_S * run.rate_hz
    ]
    if not stretches:
        return []
    at_rest = lines.find([(series[number][0], series[number][1][first:last]) for number, first, last in stretches])
    hz = spectra.spacing(spectra.usable(series))
    coarse = max(series[number][0] / (last - first) for number, first, last in stretches)
    known = [h * line.hz for line in found for h in line.harmonics]
    out = []
    for line in at_rest:
        k = round(line.hz / hz)
        inside = any(barred[CHANNELS.index(name), max(0, k - 2) : k + 3].any() for name in line.channels)
        if inside and not any(abs(line.hz - other) < 2.0 * coarse + 0.01 * other for other in known):
            longest = max(stretches, key=lambda s: s[2] - s[1])[0]
            own = [(first, last) for number, first, last in stretches if number == longest]
            out.append(replace(line, hz=_refined(line, series[longest], own, coarse)))
    return out


def moving(run: Run) -> NDArray[np.bool_]:
    """Samples of a run at which it turns, shape (N,)."""
    if run.still:
        return np.zeros(run.t.size, bool)
    return np.asarray((np.abs(run.rates) > _AT_REST).any(axis=1))


def rests_of(run: Run) -> list[Run]:
    """The stretches at rest of a run whose attitude was measured, as runs of their own; any other run as it is.

    While it moves its residual has the noise of the reference, which is not the unit's.
    """
    if run.attitude is None:
        return [run]
    return [part_of(run, a, b) for a, b in _quiet(run) if b - a >= _LEAST_S * run.rate_hz]


def at_full_rate(run: Run) -> list[Run]:
    """What there is of a run to look at its noise: the run, or of one whose rows are means stretches at rest."""
    if run.full_rate is None:
        return [run]
    return [
        part if part.still else part_of(part, a, b)
        for part in run.full_rate.stretches
        for a, b in _quiet(part)
        if b - a >= _LEAST_S * part.rate_hz
    ]


def part_of(run: Run, first: int, last: int) -> Run:
    """Some samples of a run, with what it has for each of them."""
    own = ("t", "reading", "temperature", "flagged", "attitude", *(() if run.still else ("angles", "rates")))
    parts: dict[str, Any] = {name: None if (x := getattr(run, name)) is None else x[first:last] for name in own}
    return replace(run, **parts)


def _quiet(run: Run) -> list[tuple[int, int]]:
    """Stretches of a run in which nothing turns."""
    if run.still:
        return [(0, run.t.size)]
    moves = moving(run)
    since = np.flatnonzero(moves)
    ends = np.r_[0, np.minimum(since + 1 + round(_AFTER_S * run.rate_hz), run.t.size)]
    begins = np.r_[since, run.t.size]
    return [(int(a), int(b)) for a, b in zip(ends, begins, strict=True) if b > a]


def _refined(
    line: SpectralLine, series: tuple[float, Samples], stretches: list[tuple[int, int]], within: float
) -> float:
    """Frequency of a line from all stretches of a run together, sought near what one of them resolves."""
    if line.width_hz > 0.0:
        return line.hz
    fs, r = series
    c = CHANNELS.index(max(line.channels, key=lambda name: float(line.rms[CHANNELS.index(name)])))
    x = np.zeros(r.shape[0])
    for first, last in stretches:
        part = np.nan_to_num(r[first:last, c] - np.nanmean(r[first:last, c]))
        x[first:last] = part * windows.hann(part.size, sym=False)
    size = fft.next_fast_len(4 * x.size, real=True)
    power = np.abs(fft.rfft(x, size))
    low = max(0, int((line.hz - within) * size / fs))
    high = int((line.hz + within) * size / fs) + 2
    return float((low + int(np.argmax(power[low:high]))) * fs / size)
