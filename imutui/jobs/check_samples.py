"""Rules of `check` on readings: whether samples are what their packets say, and readings at their limits."""

from collections.abc import Iterator

import numpy as np

from filters.health.finding import ADVICE
from filters.imu import CHANNELS
from imutui.instrument.registry import of_model
from imutui.jobs.channel_health import LogHealth
from imutui.jobs.check_context import CheckContext, Finding, is_polled
from imutui.jobs.check_times import Places
from imutui.jobs.quantities import plural, that_many
from imutui.logbook.audit import Audit, Part
from imutui.logbook.sample_check import SampleCheck
from imutui.logbook.samples import SampleGroups
from imutui.logbook.session_info import SessionInfo

_LIMITS = (-32768, 32767)
_MOST_WAITING = 2**16  # rows; packets and samples that are further apart in the file do not belong together


class SamplesOfPackets:
    """Whether each sample is what its packets say: how many, when, which values."""

    def __init__(self, known: Audit) -> None:
        info = known.info
        self._info = info if info is not None and info.sampling in ("stream", "polled") else None
        self._groups: SampleGroups | None = None
        if self._info is not None:
            each = is_polled(known) or of_model(self._info.instrument).gives(self._info.rate_hz)
            self._groups = SampleGroups(self._info.rate_hz, each=each)
        self._made, self._samples, self._made_degc, self._degc = _Queue(), _Queue(), _Queue(), _Queue()
        self._last_number = -1
        self._off, self._degc_off = Places(), 0

    def take(self, part: Part) -> None:
        """Look at the next part."""
        if self._info is None or self._groups is None:
            return
        heads = part.packet_heads
        numbers = None if heads is None else np.append(self._last_number, heads["sequence"].astype(np.int64))
        if heads is None or numbers is None or (np.diff(numbers) != 1).any():
            # a group that lost a packet in the file can't be made again
            self._info, self._made, self._samples = None, _Queue(), _Queue()
            return
        self._last_number = int(numbers[-1])
        # counts of temperature that are negative travel as words without a sign
        degc = part.packets["temperature"].astype(np.int16)
        counts = np.column_stack([part.packets["counts"], degc])
        _, stamps, counts, _ = self._groups.take(heads["publish_ns"], counts, np.ones(len(counts), bool))
        self._made.put(stamps, counts[:, :6])
        self._made_degc.put(counts[:, 6])
        self._samples.put(part.samples.stamp_ns, part.samples.gyro, part.samples.accel)
        self._degc.put(part.temperature_degc)
        self._compare(self._info)
        self._compare_temperatures(self._info)

    def _compare(self, info: SessionInfo) -> None:
        (made, counts), (stamps, told_gyro, told_accel) = _pairs(self._made, self._samples)
        axes, scaling = info.axes(), of_model(info.instrument).scaling(info.rate_range_dps, info.accel_range_g)
        gyro = axes.gyro_to_body(np.deg2rad(scaling.rates_dps(counts[:, :3])))
        accel = axes.accel_to_body(scaling.accels_g(counts[:, 3:]) * info.g_unit)
        same = made == stamps
        same &= np.isclose(gyro, told_gyro, rtol=1e-9, atol=1e-9).all(axis=1)
        same &= np.isclose(accel, told_accel, rtol=1e-9, atol=1e-9).all(axis=1)
        self._off.take(stamps, ~same)

    def _compare_temperatures(self, info: SessionInfo) -> None:
        (counts,), (told,) = _pairs(self._made_degc, self._degc)
        scaling = of_model(info.instrument).scaling(info.rate_range_dps, info.accel_range_g)
        same = np.isclose(scaling.temperature_degc(counts), told, rtol=0.0, atol=1e-9)
        self._degc_off += int(np.count_nonzero(~same))

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        if self._info is None or not log.paired:
            return
        made, samples = self._made.total, log.audit.samples
        if abs(made - samples) > (1 if log.found.end.cut else 0):
            what = f"The packets make {plural(made, 'sample')}, the log has {samples:,}."
            yield Finding("samples", what, "over the whole log", log.recover())
        if self._off.count:
            what = f"{that_many(self._off.count, 'sample', 'is not what its', 'are not what their')} packets say."
            yield Finding("samples", what, f"first {log.at(self._off.first_ns)}", "Trust the packets; write to us.")
        # a file that was cut off has a packet, or a sample, whose temperature is not there yet
        if self._degc_off and self._degc.total == samples:
            count = that_many(self._degc_off, "temperature", "is not what its", "are not what their")
            what = f"{count} packets say."
            yield Finding("temperatures", what, "over the whole log", "Trust the packets; write to us.")


class _Queue:
    """Rows of several columns that wait, and how many there were."""

    def __init__(self) -> None:
        self._held: list[tuple[np.ndarray, ...]] = []
        self.total = self.waiting = 0
        self.stopped = False

    def put(self, *rows: np.ndarray) -> None:
        """Add rows, shape (n, ...) each."""
        self._held.append(rows)
        self.total += len(rows[0])
        self.waiting += len(rows[0])

    def get(self, count: int) -> list[np.ndarray]:
        """Return the first rows, so many of them, and forget them; all of them once it is stopped."""
        columns = [np.concatenate(column) for column in zip(*self._held, strict=True)]
        rest = len(columns[0]) if self.stopped else count
        self._held = [tuple(column[rest:].copy() for column in columns)]
        self.waiting = len(self._held[0][0])
        return [column[:count] for column in columns]


def _pairs(made: _Queue, told: _Queue) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the rows of both that belong together, and forget them; none any more once too many wait."""
    count = 0 if made.stopped else min(made.waiting, told.waiting)
    made.stopped = told.stopped = made.stopped or max(made.waiting, told.waiting) - count > _MOST_WAITING
    return made.get(count), told.get(count)


class Health(LogHealth):
    """Faults of the channels, as the acquisition and `replay` report them."""

    def __init__(self, known: Audit) -> None:
        super().__init__(known.info or SessionInfo(sampling="foreign"))

    def take(self, part: Part) -> None:
        """Look at the next part."""
        if part.packet_heads is not None:
            self.packets(part.packet_heads["publish_ns"].astype(np.int64), part.packets)
        self.samples(part.samples)

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        for entry in self.entries():
            todo = ADVICE[entry["kind"]]
            yield Finding(
                "health", f"{entry['said']}.", f"from {entry['since_s']:.1f} s", f"{todo[0].upper()}{todo[1:]}."
            )


class Impossible:
    """Samples that no unit can have sent, by the limits that `import`, `replay` and `trace` have."""

    def __init__(self, known: Audit) -> None:
        self._check = SampleCheck()

    def take(self, part: Part) -> None:
        """Look at the next part."""
        self._check.take(part.samples)

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """Yield the first sample that is beyond a limit."""
        if (told := self._check.beyond()) is not None:
            yield Finding("samples", told[0], "over the whole log", told[1])


class Limits:
    """Readings that stand at the end of their range."""

    def __init__(self, known: Audit) -> None:
        self._packets = 0
        self._channels = np.zeros(6, bool)
        self._first_packet_ns = 0
        self._first_unread_ns: int | None = None

    def take(self, part: Part) -> None:
        """Look at the next part."""
        counts = part.packets["counts"]
        at_limit = (counts == _LIMITS[0]) | (counts == _LIMITS[1])
        if at_limit.any():
            rows = np.flatnonzero(at_limit.any(axis=1))
            if not self._packets and part.packet_heads is not None:
                self._first_packet_ns = int(part.packet_heads["publish_ns"][rows[0]])
            self._packets += rows.size
            self._channels |= at_limit.any(axis=0)
        if self._first_unread_ns is None and not (valid := part.samples.valid).all():
            self._first_unread_ns = int(part.samples.stamp_ns[int(np.argmin(valid))])

    def findings(self, log: CheckContext) -> Iterator[Finding]:
        """What it found."""
        if self._packets:
            channels = [name for name, hit in zip(CHANNELS, self._channels.tolist(), strict=True) if hit]
            count = that_many(self._packets, "packet", "has", "have")
            what = f"{count} a count at its limit ({' '.join(channels)})."
            first = log.at(self._first_packet_ns) if log.paired else ""
            cure = "The filter leaves them out. Turn the table more slowly there."
            yield Finding("limits", what, f"first {first}", cure)
        elif self._first_unread_ns is not None:
            what = f"{that_many(log.audit.unread_samples, 'sample', 'is', 'are')} flagged as no reading."
            at = log.seconds_at(self._first_unread_ns)
            yield Finding("limits", what, f"first at {at:.3f} s", "The filter leaves them out.")
