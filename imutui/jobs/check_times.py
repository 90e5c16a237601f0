"""Rules of `check` on times: the clock, the samples' stamps, gaps, and the rate."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from filters.kalman.settings import GAP_PERIODS
from imutui.instrument.registry import of_model
from imutui.jobs.check_context import CheckContext, Finding, integer
from imutui.jobs.quantities import plural, that_many
from imutui.logbook import polled_rate, schemas
from imutui.logbook.audit import Audit, Part
from imutui.logbook.reader import seconds_since

# -------------------------------------------------------------------------------------------------------- step counts
# Steps of time from one packet or sample to the next, counted by length: in bounded memory, however long the log.

MOST = 2**16  # rows of a table from which on steps are rounded, so that steps of almost the same length share one
_FEWEST_BITS = 4


class StepCounts:
    """A table of how often each step occurred with what goes with it, and where first.

    Exact while there are at most `MOST` different rows: stamps of a unit's clock make a few thousand. Beyond that
    steps keep as many significant bits as leave room.

    `steps`: ns, float64, shape (R,), increasing.
    `codes`: what goes with them, int64, shape (R,).
    `counts`: how often each row occurred, int64, shape (R,).
    `before_ns`, `after_ns`: stamps at both ends of the first one, int64, shape (R,).
    """

    def __init__(self) -> None:
        self.steps = np.empty(0)
        self.codes, self.counts, self.before_ns, self.after_ns, self._position = (np.empty(0, np.int64),) * 5
        self._bits: int | None = None
        self._taken = 0

    def take(self, steps: np.ndarray, codes: np.ndarray | None, stamps_ns: np.ndarray) -> None:
        """More of them, in order: steps, shape (n,), their codes (None: 0), and the stamps between, shape (n + 1,)."""
        if not steps.size:
            return
        codes = np.zeros(steps.size, np.int64) if codes is None else codes
        position = np.arange(self._taken, self._taken + steps.size)
        self._taken += steps.size
        held = self._rows
        more = self._rounded(steps), codes, np.ones(steps.size, np.int64), stamps_ns[:-1], stamps_ns[1:], position
        self._sum_up([np.concatenate(pair) for pair in zip(held, more, strict=True)])
        while self.steps.size > MOST and (self._bits is None or self._bits > _FEWEST_BITS):
            self._bits = 24 if self._bits is None else self._bits - 2
            self._sum_up([self._rounded(self.steps), *self._rows[1:]])

    @property
    def _rows(self) -> list[np.ndarray]:
        return [self.steps, self.codes, self.counts, self.before_ns, self.after_ns, self._position]

    def _sum_up(self, rows: list[np.ndarray]) -> None:
        """Rows with equal steps and codes become one, the first of them."""
        steps, codes, counts, before, after, position = rows
        order = np.lexsort((position, codes, steps))
        steps, codes = steps[order], codes[order]
        new = np.concatenate([[True], (np.diff(steps) != 0) | (np.diff(codes) != 0)])
        edges, first = np.flatnonzero(new), order[new]
        self.steps, self.codes, self.counts = steps[new], codes[new], np.add.reduceat(counts[order], edges)
        self.before_ns, self.after_ns, self._position = before[first], after[first], position[first]

    def _rounded(self, steps: np.ndarray) -> np.ndarray:
        if self._bits is None:
            return steps
        mantissa, exponent = np.frexp(steps)
        return np.asarray(np.ldexp(np.rint(np.ldexp(mantissa, self._bits)), exponent - self._bits))

    def __len__(self) -> int:
        return self._taken

    def median(self) -> float:
        """Median step, ns; there must be one."""
        return median(self.steps, self.counts)

    def first(self, which: np.ndarray) -> int:
        """The row of those chosen by a mask, shape (R,), that occurred first; there must be one."""
        rows = np.flatnonzero(which)
        return int(rows[np.argmin(self._position[rows])])


def median(values: np.ndarray, counts: np.ndarray) -> float:
    """Median of values, each there so many times, as numpy's of all of them; shapes (R,), R > 0."""
    order = np.argsort(values, kind="stable")
    until = np.cumsum(counts[order])
    total = int(until[-1])
    middle = values[order[np.searchsorted(until, [(total - 1) // 2, total // 2], side="right")]]
    return float(np.mean(middle))


# -------------------------------------------------------------------------------------------------------- check times

_RATE_OFF = 0.02
_WHOLE = 0.1  # a step so near to whole periods, in periods, is of samples that are missing
_STAMP_SLACK_NS = 20_000_000
_EARLIEST_NS = 946_684_800_000_000_000  # 2000: before that it is no UTC but some other clock
_CLOCK = "The times are not to be trusted there; replay a part without it (--start, --end)."
_CHANNEL_BITS = 2 ** np.arange(6)


@dataclass(slots=True)
class Places:
    """How often something was, and the stamp where first, UTC, ns."""

    count: int = 0
    first_ns: int = 0

    def take(self, stamps: np.ndarray, which: np.ndarray) -> None:
        """Those of a part's stamps, shape (N,), where a mask is true."""
        if found := int(np.count_nonzero(which)):
            self.first_ns = self.first_ns if self.count else int(stamps[int(np.argmax(which))])
            self.count += found


class Times:
    """Rules of time that a log is written by: UTC, never backwards, no jump against the monotonic clock."""

    def __init__(self, known: Audit) -> None:
        self._own = bool(known.session)
        self._back, self._early, self._other = Places(), Places(), Places()
        self._no_numbers: dict[int, tuple[int, int, int]] = {}
        self._samples = 0
        self._last = np.empty(0, np.int64)
        self._offset = np.empty(0, np.int64)
        self._jump: tuple[int, int] | None = None

    def take(self, part: Part) -> None:
        """Look at the next part."""
        stamps = np.concatenate([self._last, part.samples.stamp_ns])
        self._back.take(stamps, np.diff(stamps) <= 0)
        self._last = stamps[-1:]
        self._take_numbers(part)
        self._samples += part.samples.stamp_ns.size
        heads = part.sample_heads
        if heads is not None and self._own:
            self._other.take(part.samples.stamp_ns, heads["publish_ns"] != part.samples.stamp_ns)
            self._early.take(part.samples.stamp_ns, heads["publish_ns"] - heads["log_ns"] > _STAMP_SLACK_NS)
        if part.packet_heads is not None:
            self._take_offset(part.packet_heads["log_ns"], part.packets["host_monotonic_ns"])

    def _take_numbers(self, part: Part) -> None:
        """Count samples by which of their channels are no numbers: what a log lacks is known at its end only."""
        wrong = ~np.isfinite(np.hstack([part.samples.gyro, part.samples.accel]))
        if not wrong.any():
            return
        kinds = wrong @ _CHANNEL_BITS
        for kind in np.flatnonzero(np.bincount(kinds)[1:]) + 1:
            which = kinds == kind
            first = int(np.argmax(which))
            new = 0, self._samples + first, int(part.samples.stamp_ns[first])
            count, at, ns = self._no_numbers.get(int(kind), new)
            self._no_numbers[int(kind)] = (count + int(np.count_nonzero(which)), at, ns)

    def _take_offset(self, log_ns: np.ndarray, host_ns: np.ndarray) -> None:
        offset = np.concatenate([self._offset, log_ns - host_ns])
        steps = np.flatnonzero(np.diff(offset)) if self._jump is None else self._offset[:0]
        if steps.size:
            k = int(steps[0])
            at = k + 1 - self._offset.size
            self._jump = int(offset[k + 1]) - int(offset[k]), int(log_ns[at])
        self._offset = offset[-1:]

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        for topic, run in log.audit.messages.items():
            if run.first_ns < _EARLIEST_NS:
                what = f"{topic}: the log time is not UTC: it begins before the year 2000."
                yield Finding("log_time", what, "from the first message on", _CLOCK)
            # samples of another program are put into order where they can be
            if run.back_ns is not None and self._own:
                what = f"{topic}: log time goes back in {plural(run.back, 'place')}."
                yield Finding("log_time", what, f"first {log.at(run.back_ns)}", _CLOCK)
        yield from self._of_samples(log)
        if self._jump is not None and log.paired and self._own:
            step, at = self._jump
            what = f"Log time jumps by {step / 1e9:+.6f} s against the monotonic clock."
            yield Finding("log_time", what, log.at(at), _CLOCK)

    def _of_samples(self, log: CheckContext) -> Iterator[Finding]:
        """Stamps of the samples: in order, finite, and those of their messages."""
        if self._back.count:
            what = f"Sample time does not increase in {plural(self._back.count, 'place')}; a replay refuses the log."
            yield Finding("stamps", what, f"first {log.at(self._back.first_ns)}", log.recover())
        count, first_ns = self._bad_numbers(log.audit.lacks)
        if count:
            what = f"{that_many(count, 'sample', 'is no number', 'are not numbers')}; a replay refuses the log."
            cure = "Remove them in the program that wrote the file."
            yield Finding("stamps", what, f"first {log.at(first_ns)}", cure)
        run = log.audit.messages.get(schemas.IMU)
        if run is None or not self._own or run.count != log.audit.samples:
            return
        if self._other.count:
            what = "A sample's stamp is not its message's publish time."
            yield Finding("stamps", what, f"first {log.at(self._other.first_ns)}", _CLOCK)
        if self._early.count:
            what = f"{that_many(self._early.count, 'sample', 'is', 'are')} stamped later than received."
            yield Finding("stamps", what, f"first {log.at(self._early.first_ns)}", _CLOCK)

    def _bad_numbers(self, lacks: np.ndarray) -> tuple[int, int]:
        """Samples that are no numbers in a channel that the log has, and the stamp of the first."""
        lacking = 0 if lacks.all() else int(lacks @ _CHANNEL_BITS)
        bad = [told for kind, told in self._no_numbers.items() if kind & ~lacking]
        if not bad:
            return 0, 0
        _, _, first_ns = min(bad, key=lambda told: told[1])
        return sum(count for count, _, _ in bad), first_ns


class Gaps:
    """Gaps between samples, and the rate."""

    def __init__(self, known: Audit) -> None:
        self._steps = StepCounts()
        self._last = np.empty(0, np.int64)
        self._first_ns: int | None = None
        self._longest = (-np.inf, 0.0)

    def take(self, part: Part) -> None:
        """Look at the next part."""
        stamps = np.concatenate([self._last, part.samples.stamp_ns])
        self._last = stamps[-1:]
        if stamps.size < 2:
            self._first_ns = int(stamps[0]) if stamps.size and self._first_ns is None else self._first_ns
            return
        self._first_ns = int(stamps[0]) if self._first_ns is None else self._first_ns
        self._steps.take(np.diff(stamps).astype(np.float64), None, stamps)
        t = seconds_since(stamps, self._first_ns)
        steps = np.diff(t)
        k = int(np.argmax(steps))
        if steps[k] > self._longest[0]:
            self._longest = float(steps[k]), float(t[k])

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        if log.audit.samples < 3:
            return
        info, steps = log.audit.info, self._steps
        period = 1.0 / info.rate_hz if info is not None else steps.median() / 1e9
        long = steps.steps / 1e9 > GAP_PERIODS * period
        count = int(steps.counts[long].sum())
        missing = self._missing(period) if info is None else 0
        few = count <= max(1.0, 0.001 * len(steps)) or (info is not None and log.paired)
        # bursts of a host's stamps are no gaps in the samples
        if missing or (count and few):
            longest, at = self._longest
            said = [f"{plural(count, 'gap')} between samples, the longest {longest:.3f} s."] if count else []
            said += [f"By the times {that_many(missing, 'sample', 'is', 'are')} missing."] if missing else []
            wide = long if count else steps.steps / 1e9 > (1.0 + _WHOLE) * period
            first = log.seconds_at(int(steps.before_ns[steps.first(wide)]))
            where = f"first at {first:.3f} s, longest at {at:.3f} s"
            cure = "The filter predicts through 2 s at most; trace leaves gaps out."
            yield Finding("gaps", " ".join(said), where, cure)
        if info is None or info.sampling == "imported":
            return
        if log.polled:
            yield from self._polled_rate(log, info.rate_hz)
        elif not count:
            yield from _rate(log, min(info.rate_hz, of_model(info.instrument).most_rate_hz))

    def _missing(self, period: float) -> int:
        """Return how many samples are missing, if all long steps are of whole periods."""
        ratio, counts = self._steps.steps / 1e9 / period, self._steps.counts
        long = ratio > 1.0 + _WHOLE
        whole = long & (np.abs(ratio - np.rint(ratio)) < _WHOLE)
        even = counts[whole].sum() > 0.9 * counts[long].sum()
        return int((counts * (np.rint(ratio) - 1.0))[whole].sum()) if even else 0

    def _polled_rate(self, log: CheckContext, rate_hz: float) -> Iterator[Finding]:
        """Whether so many packets a second were asked for as should be, while the unit answered."""
        steps, counts = self._steps.steps / 1e9, self._steps.counts
        short = steps <= polled_rate.usual_step_s(rate_hz)
        if counts[short].sum() < (1.0 - polled_rate.RARE) * len(self._steps):
            short = steps <= polled_rate.longest_step_s(rate_hz)
        count, seconds = int(counts[short].sum()), float((steps * counts)[short].sum())
        # what was lost is no request too few, but for that in the long steps, one at the least in each
        lost = integer(log.audit.diagnostics.get("lost_packets"))
        requests = count + max(0, lost - (len(self._steps) - count))
        slow = polled_rate.finding(rate_hz, requests / seconds) if count >= polled_rate.FEWEST else None
        if slow is not None:
            what, _, cure = slow.partition(". ")
            yield Finding("rate", f"{what}.", "over the whole log", cure)


def _rate(log: CheckContext, rate_hz: float) -> Iterator[Finding]:
    """Whether samples came as often as was asked for."""
    with np.errstate(divide="ignore", invalid="ignore"):
        measured = np.float64(log.audit.samples - 1) / log.seconds_at(log.audit.last_ns)
    if abs(measured / rate_hz - 1.0) > _RATE_OFF:
        what = f"{rate_hz:g} Hz were asked for, {measured:.3f} Hz came."
        yield Finding("rate", what, "over the whole log", "Ask for a rate that the unit and its line speed can give.")
