"""The filter over a log: the same step as live, fed with what the file holds."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from filters import runner
from filters.runner import Estimate, Estimator
from imutui.logbook import reader, results, schemas
from imutui.logbook.reader import Log, UnreadableLogError
from imutui.logbook.results import Counters, Timings
from imutui.logbook.session import SessionInfo
from imutui.logbook.writer import LogWriter

_ESTIMATES_HZ = 10.0


@dataclass(frozen=True, slots=True)
class Options:
    """What a replay may set differently from the recording.

    Attributes
    ----------
    start, end : float or None
        Part of the log, s since its first sample.
    overrides : dict
        Fields of `SessionInfo` to replace: reference, filter, measurements, seed, kappa, …
    speed : float or None
        Times real time to pace the samples at; None goes as fast as it can.
    output : Path or None
        Log of estimates to write.
    overwrite : bool
        Replace `output` if it exists.
    """

    start: float | None = None
    end: float | None = None
    overrides: dict[str, Any] | None = None
    speed: float | None = None
    output: Path | None = None
    overwrite: bool = False


def replay(path: Path, options: Options, progress: Callable[[float], None] = lambda share: None) -> dict[str, Any]:
    """Run the filter over one log.

    Parameters
    ----------
    path : Path
        The log.
    options : Options
        Part, settings, pace.
    progress : callable
        Told the share done, 0 to 1, now and then.

    Returns
    -------
    dict
        The result document, contracts section 5; `damage` says what is wrong with the file, if anything.

    Raises
    ------
    UnreadableLogError
        If there is nothing to replay.
    ValueError
        If an override is not possible; the message names it.
    DivergenceError
        If the filter broke down; the message names the sample.
    """
    started = time.perf_counter()
    log = reader.read(path)
    info = session_of(log, options.overrides or {})
    part = select(log, options.start, options.end)
    read_s = time.perf_counter() - started

    estimator = Estimator(info.settings())
    sink = _EstimateSink(options, info, log) if options.output is not None else None
    started = time.perf_counter()
    for estimate in run(estimator, log, part, options.speed, progress):
        if sink is not None:
            sink.take(estimate, estimator, int(log.stamp_ns[part][estimate.index]))
    filter_s = time.perf_counter() - started
    result = results.document(
        estimator,
        info,
        path,
        finished=log.finished,
        counters=Counters.from_diagnostics(log.diagnostics),
        timings=Timings(filter_s, read_s),
        log_sha256=reader.sha256(path),
    )
    if log.damage:
        result["damage"] = log.damage
    if sink is not None:
        sink.finish(result)
    return result


def session_of(log: Log, overrides: dict[str, Any]) -> SessionInfo:
    """Session of a log with overrides; a foreign file's rate is that of its samples."""
    info = log.info
    if not log.own:
        stamps = log.stamp_ns
        span = float(stamps[-1] - stamps[0]) / 1e9 if stamps.size > 1 else 0.0
        rate = (stamps.size - 1) / span if span > 0.0 else 1.0
        info = replace(info, rate_hz=rate, sampling="foreign", accel_sign=1)
    if log.reference is not None:
        info = replace(info, reference=log.reference)
    if info.filter == "none":
        info = replace(info, filter="spkf")
    return replace(info, **overrides)


def select(log: Log, start: float | None, end: float | None) -> slice:
    """Samples from `start` to `end`, s since the first, as a slice."""
    t = log.seconds()
    first = 0 if start is None else int(np.searchsorted(t, start, side="left"))
    last = t.size if end is None else int(np.searchsorted(t, end, side="right"))
    if last - first < 1:
        raise UnreadableLogError(
            f"{log.path}: --start and --end leave no sample; the log lasts {t[-1]:.3f} s. Choose a part inside it."
        )
    return slice(first, last)


def run(
    estimator: Estimator, log: Log, part: slice, speed: float | None, progress: Callable[[float], None]
) -> Iterator[Estimate]:
    """Feed part of a log and yield the estimates."""
    stamps, gyro, accel = log.stamp_ns[part], log.gyro[part], log.accel[part]
    first_ns = int(stamps[0])
    started = time.monotonic()
    for k, stamp in enumerate(map(int, stamps)):
        t = reader.seconds_since(stamp, first_ns)
        if speed is not None:
            time.sleep(max(0.0, t / speed - (time.monotonic() - started)))
        yield from runner.step(estimator, t, gyro[k], accel[k])
        if k % 512 == 0:
            progress(k / stamps.size)
    yield from runner.finish(estimator)
    progress(1.0)


class _EstimateSink:
    """Writes estimates at 10 Hz of log time."""

    def __init__(self, options: Options, info: SessionInfo, log: Log) -> None:
        assert options.output is not None
        self._info = info
        self._next = 0.0
        text = f'# replay of {log.path.name}\nfilter = "{info.filter}"\nreference = "{info.reference}"\n'
        self._writer = LogWriter(options.output, info, text, time.time_ns(), overwrite=options.overwrite)

    def take(self, estimate: Estimate, estimator: Estimator, stamp_ns: int) -> None:
        """Write this estimate if it is due."""
        if estimate.t >= self._next - 1e-9:
            message = results.estimate_message(estimate, estimator, self._info, stamp_ns)
            self._writer.message(schemas.ESTIMATE, message, stamp_ns, stamp_ns)
            self._next = max(self._next + 1.0 / _ESTIMATES_HZ, estimate.t)

    def finish(self, result: dict[str, Any]) -> None:
        """Close the file with the result as its summary."""
        self._writer.finish(result, time.time_ns())
