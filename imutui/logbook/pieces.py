"""A log of any length in pieces: all of it once, with a bounded part of it in memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from imutui.logbook import reader
from imutui.logbook.reader import Log, Table, UnreadableLogError, parts
from imutui.logbook.reading import AS_STATED, Reading
from imutui.logbook.sample_check import SampleCheck
from imutui.logbook.samples import Samples

ROWS = 2**17  # samples in a piece: a quarter of an hour at 133 Hz


@dataclass(slots=True)
class Outline:
    """Facts on a whole log that its first piece cannot be used without."""

    log: Log  # without samples and table; `damage` and `finished` are those of the whole file
    reading: Reading = AS_STATED  # how the log is read
    samples: int = 0  # how many there are
    # first_ns, last_ns: UTC of the first and the last, ns
    first_ns: int = 0
    last_ns: int = 0
    first_temperature: float = float("nan")  # degC; NaN if the log has none
    # has_angles, has_rates: whether the table's are known anywhere
    has_angles: bool = False
    has_rates: bool = False
    # channels that are NaN throughout, bool, shape (6,)
    lacks: np.ndarray = field(default_factory=lambda: np.ones(6, bool))
    kept: list[Samples] = field(default_factory=list)  # parts, evenly spread, as many as were asked for

    @property
    def seconds(self) -> float:
        """Time from the first sample to the last."""
        return float(reader.seconds_since(self.last_ns, self.first_ns))


def outline(
    path: Path,
    rows: int = ROWS,
    keep: int = 0,
    tell: Callable[[float], None] = lambda seconds: None,
    reading: Reading = AS_STATED,
) -> Outline:
    """Look at every sample of a log once.

    `keep`: most parts to be kept; at least half as many are, if the log has them.
    `tell`: called with the seconds of the log that are done.
    Raises UnreadableLogError as `reader.read`.
    """
    found, check, every = Outline(Log(path), reading), SampleCheck(), 1
    for number, part in enumerate(parts(path, rows, reading=reading)):
        found.log, samples = part, part.samples
        check.take(samples)
        if len(samples):
            found.first_ns = found.first_ns if found.samples else part.first_ns
            found.last_ns = int(samples.stamp_ns[-1])
            found.samples += len(samples)
            tell(found.seconds)
            if keep and number % every == 0 and len(samples) >= min(rows, found.samples):
                if len(found.kept) == keep:
                    found.kept, every = found.kept[::2], 2 * every
                if number % every == 0:
                    found.kept.append(samples)
        known = samples.degc[np.isfinite(samples.degc)]
        if known.size and np.isnan(found.first_temperature):
            found.first_temperature = float(known[0])
        found.has_angles |= bool(np.isfinite(part.table.angles_deg).all(axis=1).any())
        found.has_rates |= bool(np.isfinite(part.table.rates_dps).all(axis=1).any())
    if trouble := check.trouble(path):
        raise UnreadableLogError(trouble)
    found.lacks = check.lacks
    found.log = replace(found.log, samples=Samples(), table=Table(), states=Table())
    return found


def pieces(known: Outline, rows: int = ROWS) -> Iterator[tuple[Samples, Table]]:
    """Yield all samples of a log in order, and what its table did meanwhile.

    `known`: of the log; samples that were written since it was outlined are left out.
    `rows`: samples in a piece, or a few more.
    Raises UnreadableLogError as `reader.read`.
    """
    for part in parts(known.log.path, rows, reading=known.reading):
        samples = part.samples
        if len(samples) and samples.stamp_ns[-1] > known.last_ns:
            samples = samples.rows(samples.stamp_ns <= known.last_ns)
        # a log's first temperature holds for the samples before it, however long before
        degc = np.where(np.isnan(samples.degc), known.first_temperature, samples.degc)
        yield replace(samples, degc=degc), part.table
