"""A run too long to be held: its faults, its lines and means of its readings, found piece after piece.

Lines are sought in stretches that are spread evenly over the run; all else is looked at in every piece. What it leaves
out: where pieces come from, and runs whose attitude was measured.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from filters.channels import CHANNELS
from filters.effects import faults
from filters.effects.fault_records import DataFault, over_pieces
from filters.effects.lines import SpectralLine
from filters.tracing.line_search import lines_of, part_of, without_lines
from filters.tracing.residual import perfect, residual
from filters.tracing.run import FullRate, Run
from filters.types import Array

ROWS_A_BLOCK = 8  # means in a block, so that their differences say how large the noise is
_GAP_S = 1.0
_LEAST = 8  # samples between two gaps that are looked at
_MORE = 64  # rows that gaps may add
_LEAST_GOOD = 0.85  # of the readings in a mean, as of those in a block

# columns of a table of samples, or of means: time, residual, temperature, angles, rates
_T, _R, _DEGC, _ANGLES, _RATES = 0, slice(1, 7), 7, slice(8, 11), slice(11, 14)


def lines_in(stretches: Sequence[Run]) -> tuple[SpectralLine, ...]:
    """Lines in stretches of one run or several."""
    clean = [_without_faults(run, run.t.size)[0] for run in map(_longest, stretches)]
    return tuple(lines_of(clean, clean))


def condensed(
    pieces: Iterable[Run], stretches: Sequence[Run], lines: Sequence[SpectralLine], block_s: float, samples: int
) -> Run:
    """A run whose rows are means over eighths of a block, from pieces of it that follow each other.

    A row's reading is what a perfect unit reads in its middle plus the mean residual, so that its residual is exact
    however the unit moves.

    `pieces`: all of it in order, each with at least 2 samples; those in which nothing turns may have one row of angles.
    `stretches`: some of the pieces, in which noise is looked at later.
    `lines`: from `lines_in`, which are taken out.
    `block_s`: length of the blocks that the rows will be averaged to, s.
    `samples`: of the whole run.
    """
    found: list[list[DataFault]] = []
    before: Run | None = None
    unread = set(range(len(CHANNELS)))
    # one table for all means: many small ones among what each piece needs would keep its memory from being used again
    table, count, per, held = np.empty((0, 14)), 0, 1, np.empty((0, 14))
    for piece in itertools.chain.from_iterable(map(_between_gaps, pieces)):
        if before is None:
            per = max(1, int(piece.rate_hz * block_s / ROWS_A_BLOCK))
            table = np.empty((samples // per + _MORE, 14))
        clean, own = _without_faults(piece, samples, before)
        found.append(own)
        means, held = _means(np.concatenate([held, _samples(without_lines(clean, lines))]), per)
        if count + len(means) > len(table):
            table = np.concatenate([table, np.empty((len(table) // 4 + len(means), 14))])
        table[count : count + len(means)] = means
        count, before = count + len(means), piece
        unread &= set(piece.unread)
    assert before is not None
    table = table[:count]
    r, angles, rates = table[:, _R].copy(), table[:, _ANGLES], table[:, _RATES]
    turns = bool(np.ptp(angles, axis=0).any() or rates.any())
    bad = np.isnan(r)
    seconds = float(before.t[-1] - table[0, _T]) + 0.5 * (per - 1) / before.rate_hz
    run = replace(
        before,
        t=table[:, _T].copy(),
        temperature=table[:, _DEGC].copy() if before.temperature is not None else None,
        angles=np.unwrap(angles, axis=0) if turns else angles[:1].copy(),
        rates=rates.copy() if turns else rates[:1].copy(),
        flagged=bad if bad.any() else None,
        unread=tuple(sorted(unread)),
        full_rate=FullRate(
            samples,
            (samples - 1) / seconds,
            tuple(over_pieces(found)),
            tuple(lines),
            tuple(without_lines(_without_faults(run, samples)[0], lines) for run in map(_longest, stretches)),
        ),
    )
    r[bad] = 0.0
    r += perfect(run)
    return replace(run, reading=r)


def _without_faults(run: Run, samples: int, before: Run | None = None) -> tuple[Run, list[DataFault]]:
    """A piece with its faults flagged, and what they are; a gap after the piece before it is its own."""
    t, reading, known = run.t, run.reading, perfect(run)
    if before is not None:
        t, reading = np.append(before.t[-1], t), np.concatenate([before.reading[-1:], reading])
        known = known if len(known) == 1 else np.concatenate([known[:1], known])
    flagged, found = faults.find(t, reading, known, run.lsb, samples)
    flagged = flagged[t.size - run.t.size :]
    if run.flagged is not None:
        flagged |= run.flagged
    return replace(run, flagged=flagged if flagged.any() else None), found


def _between_gaps(run: Run) -> list[Run]:
    """The parts of a piece between gaps: over one of them its rate is not that of its samples, and no line goes on."""
    edges = [0, *(1 + np.flatnonzero(np.diff(run.t) > _GAP_S)).tolist(), run.t.size]
    return [part_of(run, a, b) for a, b in itertools.pairwise(edges) if b - a >= _LEAST]


def _longest(run: Run) -> Run:
    return max(_between_gaps(run), key=lambda part: part.t.size, default=run)


def _samples(run: Run) -> Array:
    """Table of a piece's samples, shape (n, 14)."""
    out = np.empty((run.t.size, 14))
    out[:, _T], out[:, _R], out[:, _ANGLES], out[:, _RATES] = run.t, residual(run), run.angles, run.rates
    out[:, _DEGC] = np.nan if run.temperature is None else run.temperature
    return out


def _means(table: Array, per: int) -> tuple[Array, Array]:
    """Means over so many samples each, none of which reaches over a gap as long, and the samples that are left."""
    t = table[:, _T]
    step = float(t[-1] - t[0]) / max(1, t.size - 1)
    begins = [0, *(1 + np.flatnonzero(np.diff(t) > max(2, per) * step)).tolist(), t.size]
    starts = np.concatenate([np.arange(a, b, per) for a, b in itertools.pairwise(begins)])
    left = int(starts[-1]) if t.size - starts[-1] < per else t.size
    starts, whole = starts[starts < left], table[:left]
    if not starts.size:
        return whole, table
    good = np.isfinite(whole[:, _R])
    counts, of_good = np.diff(np.append(starts, left)), np.add.reduceat(good, starts, axis=0, dtype=np.int64)
    means = np.add.reduceat(whole, starts, axis=0) / counts[:, None]
    r = np.add.reduceat(np.where(good, whole[:, _R], 0.0), starts, axis=0) / np.maximum(of_good, 1)
    means[:, _R] = np.where(of_good >= _LEAST_GOOD * per, r, np.nan)
    return means, table[left:].copy()
