"""One run of output samples: packets to the disk first, then averaged to samples, then through the filter.

Starting to record starts a new run, so that the file holds every sample that its filter has seen and a replay gives the
same estimates. There is a run without a file as well: viewers see readings and estimates before anything is recorded.
"""

import time
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from filters.health.finding import HealthEntry
from filters.health.monitor import HealthMonitor
from filters.kalman.augmentation import MakeEffects
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.instrument.clock import Stamp
from imutui.instrument.counts import DataPacket
from imutui.instrument.driver import Driver
from imutui.instrument.names import DEFAULT
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import health, polled_rate, schemas
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import Encoded, LogWriter
from imutui.session.live_filter import LiveFilter, RunHistory
from imutui.session.timebase import Timebase
from imutui.table.motion import TableState

if TYPE_CHECKING:
    from filters.kalman.runner import Estimator

Stamped: TypeAlias = tuple[DataPacket, Stamp, int]
"""A packet with its stamp, and when it was read, monotonic, ns."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One output sample."""

    stamp_ns: int  # mean of its packets' sampling instants, monotonic, ns
    counts: np.ndarray  # mean counts of rates and accelerations, instrument axes, shape (6,)
    temperature: float  # mean counts of the temperature sensor
    packets: int  # how many packets it is the mean of
    valid: bool = True  # no count is at its limit, where it says only "this or more": the filter predicts through it


class Averager:
    """Groups packets by time, not by number: 133.3 Hz is no multiple of most rates, and packets may be lost.

    A period runs from a whole multiple of 1/rate after the first packet to the next; its sample comes with the first
    packet after it. A period without packets gives no sample.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = 1e9 / rate_hz
        self._first_ns: int | None = None
        self._number = 0
        self._stamps: list[int] = []
        self._counts = np.zeros(7)
        self._valid = True

    def add(self, stamp_ns: int, counts: Sequence[int], valid: bool = True) -> Sample | None:
        """Take a packet's seven readings; return the sample of the period before if this is the first one after it."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        number = int((stamp_ns - self._first_ns) / self._period_ns)
        done = self._close() if number > self._number else None
        self._number = max(number, self._number)
        self._stamps.append(stamp_ns)
        self._counts += counts
        self._valid &= valid
        return done

    def _close(self) -> Sample | None:
        n = len(self._stamps)
        if not n:
            return None
        first = self._stamps[0]
        stamp = first + round(sum(s - first for s in self._stamps) / n)
        mean = self._counts / n
        done = Sample(stamp, mean[:6], float(mean[6]), n, self._valid)
        self._stamps, self._counts, self._valid = [], np.zeros(7), True
        return done


_RATE_SPAN_NS = 10_000_000_000
_STILL = ("level", "gravity")  # references that say that the table stands


@dataclass(slots=True)
class LineCounters:
    """What came over the line, and what did not, since the run of samples began.

    `lost_packets` are certain; `lost_packets_max` counts those too that a silent unit may have sent. `doubled_packets`
    came a second time, and count for nothing else.
    """

    packets: int = 0
    lost_packets: int = 0
    lost_packets_max: int = 0
    bad_checksums: int = 0
    discarded_bytes: int = 0
    doubled_packets: int = 0


@dataclass(slots=True)
class SampleRate:
    """Samples a second over the last 10 s (at least two samples)."""

    stamps: list[int] = field(default_factory=list)

    def add(self, stamps_ns: list[int]) -> None:
        """Take samples' stamps."""
        self.stamps += stamps_ns
        since = bisect_left(self.stamps, self.stamps[-1] - _RATE_SPAN_NS, 1)
        del self.stamps[: max(0, min(since - 1, len(self.stamps) - 3))]

    def hz(self) -> float | None:
        """Rate, or None before there are three samples."""
        if len(self.stamps) < 3:
            return None
        return (len(self.stamps) - 1) * 1e9 / (self.stamps[-1] - self.stamps[0])


class _ChannelHealth:
    """Feeds the packets of a run, at their full rate, to the monitor of channel health."""

    def __init__(self, info: SessionInfo, instrument: type[Driver]) -> None:
        self._info = info
        self._readings = health.Readings(instrument.scaling(info.rate_range_dps, info.accel_range_g), info.g_unit)
        self._monitor = HealthMonitor(health.expected(info, self._readings.lsb))
        self._first_ns: int | None = None

    def add(self, stamps_ns: np.ndarray, counts: np.ndarray) -> None:
        """Take packets: sampling instants, ns, and readings in counts, (N, 7)."""
        self._first_ns = int(stamps_ns[0]) if self._first_ns is None else self._first_ns
        self._monitor.add((stamps_ns - self._first_ns) / 1e9, *self._readings.of(counts))

    def entries(self, estimator: "Estimator | None", *, final: bool) -> list[HealthEntry]:
        """Faults found so far."""
        sd, moving = health.bias_sd(estimator, self._info), not self._info.effects_sha256
        return health.entries(self._monitor.findings(sd, moving=moving, final=final))


class SamplePipeline:
    """Packets in; raw packets, samples and estimates out, to the file (`writer`) if there is one.

    `motion` is what the filter's reference needs, `effects` makes the effects that join the filter.
    Raises InputError if the filter's settings cannot be.
    """

    def __init__(
        self,
        info: SessionInfo,
        timebase: Timebase,
        writer: LogWriter | None,
        motion: Profile | Trajectory | None = None,
        effects: MakeEffects | None = None,
        instrument: type[Driver] = INSTRUMENTS[DEFAULT],
    ) -> None:
        self.info = info
        self._description: dict[str, str] = {}
        self.counters = LineCounters()
        self.samples = self.marks = 0
        self.rate = SampleRate()
        self.started_ns: int | None = None  # when the first packet was sampled, monotonic
        self.flushed_ns: int | None = None  # when all was last seen onto the disk, monotonic
        self.first_stamp_ns: int | None = None  # sampling instant of the first sample, UTC
        self.history = RunHistory()
        self._health = _ChannelHealth(info, instrument)
        self.filter = LiveFilter(info, motion, effects, self.history.estimates) if info.filter != "none" else None
        self._writer = writer
        self._timebase = timebase
        self._axes = info.axes()
        self._count_limits = instrument.count_limits
        self._scaling = instrument.scaling(info.rate_range_dps, info.accel_range_g)
        self._uncertainty_ns = 0  # the largest since it was last written
        # of a unit that is polled, or streams at the rate that is asked, each packet is a sample
        each = info.sampling != "stream" or instrument.gives(info.rate_hz)
        self._averager = None if each else Averager(info.rate_hz)

    def packets(self, arrived: Sequence[Stamped]) -> np.ndarray:
        """Take packets; returns their readings, rates, accelerations and temperature, (N, 7). Raises OSError.

        Messages are in the order in which they would come of one packet after the other.
        """
        counts = np.array([(*packet.rates, *packet.accels, packet.temperature) for packet, _, _ in arrived])
        if self.started_ns is None:
            # the first packet is on the disk before the filter is loaded, which takes its time
            self.started_ns = arrived[0][1].monotonic_ns
            self._take(arrived[:1], counts[:1], is_first=True)
            arrived = arrived[1:]
        if arrived:
            self._take(arrived, counts[-len(arrived) :])
        return counts

    def _take(self, arrived: Sequence[Stamped], counts: np.ndarray, *, is_first: bool = False) -> None:
        least, most = self._count_limits
        at_limit = np.any((counts[:, :6] == least) | (counts[:, :6] == most), axis=1)
        before = self.counters.packets
        self.counters.packets += len(arrived)
        for _, stamp, _ in arrived:
            self._uncertainty_ns = max(self._uncertainty_ns, stamp.uncertainty_ns)
            if stamp.gap is not None:
                self.counters.lost_packets += stamp.gap.lost_min
                self.counters.lost_packets_max += stamp.gap.lost_max
        self._health.add(np.array([stamp.monotonic_ns for _, stamp, _ in arrived]), counts)
        messages: list[list[Encoded]] = [[] for _ in arrived]
        for of_packet, raw in zip(messages, self._raws(arrived, counts, at_limit, before), strict=False):
            of_packet.append(raw)
        if is_first:
            self._write(messages)
            self._flush()
            messages = [[]]
        stamps = np.array([stamp.monotonic_ns for _, stamp, _ in arrived])
        if self._averager is None:
            self._samples(np.arange(len(arrived)), stamps, counts.astype(float), ~at_limit, arrived, messages)
        else:
            found = map(self._averager.add, stamps.tolist(), counts.tolist(), (~at_limit).tolist())
            done = {k: sample for k, sample in enumerate(found) if sample is not None}
            if done:
                means = np.array([(*sample.counts, sample.temperature) for sample in done.values()])
                when, valid = (np.array([getattr(s, name) for s in done.values()]) for name in ("stamp_ns", "valid"))
                self._samples(np.array(list(done)), when, means, valid, arrived, messages)
        self._write(messages)

    def health(self, *, final: bool = False) -> list[HealthEntry]:
        """Faults of the channels over all packets so far; `final` as in `HealthMonitor.findings`."""
        live = self.filter
        estimator = None if live is None or live.failure is not None else live.estimator
        return self._health.entries(estimator, final=final)

    def add_line_errors(self, bad_checksums: int, discarded_bytes: int, doubled_packets: int = 0) -> None:
        """Take what the line has cost since the packet before."""
        self.counters.bad_checksums += bad_checksums
        self.counters.discarded_bytes += discarded_bytes
        self.counters.doubled_packets += doubled_packets

    def poll_unanswered(self) -> None:
        """Take note that a packet was asked for and did not come."""
        self.counters.lost_packets += 1
        self.counters.lost_packets_max += 1

    def _raws(
        self, arrived: Sequence[Stamped], counts: np.ndarray, at_limit: np.ndarray, before: int
    ) -> Iterator[Encoded]:
        """Messages of packets as they came, after so many others."""
        if self._writer is None:
            return
        offset = self._timebase.utc_ns(0)
        host = np.array([host_ns for _, _, host_ns in arrived])
        flags = [
            (schemas.FLAG_LOST_BEFORE if stamp.gap is not None else 0) | (schemas.FLAG_HOST_STAMP * stamp.by_host)
            for _, stamp, _ in arrived
        ]
        raws = np.zeros(len(arrived), schemas.RAW_DTYPE)
        raws["sequence"] = np.arange(before, before + len(arrived))
        raws["host_monotonic_ns"] = host
        raws["counts"], raws["temperature"] = counts[:, :6], counts[:, 6] % 65536
        raws["ticks"] = [packet.ticks for packet, _, _ in arrived]
        raws["flags"] = np.array(flags) | schemas.FLAG_LIMIT * at_limit
        details = [more for packet, _, _ in arrived if (more := packet.details) is not None]
        if details:
            raws["rate_temperatures"] = [more.rate_temperatures for more in details]
            raws["board_temperature"] = [more.board_temperature for more in details]
            raws["status"] = [more.status for more in details]
        data = schemas.encode_raws(raws, details=bool(details))
        for encoded, log_ns, (_, stamp, _) in zip(data, (host + offset).tolist(), arrived, strict=True):
            yield schemas.RAW, encoded, log_ns, stamp.monotonic_ns + offset

    def _samples(
        self,
        places: np.ndarray,
        stamps: np.ndarray,
        counts: np.ndarray,
        valid: np.ndarray,
        arrived: Sequence[Stamped],
        messages: list[list[Encoded]],
    ) -> None:
        """Use samples: which packets complete them, their stamps, mean readings, validity.

        What is to be written of them goes behind the messages of those packets, `messages`.
        """
        stamps_ns = self._timebase.utc_ns(0) + stamps
        gyro = self._axes.gyro_to_body(np.deg2rad(self._scaling.rates_dps(counts[:, :3])))
        accel = self._axes.accel_to_body(self._scaling.accels_g(counts[:, 3:6]) * self.info.g_unit)
        degc = self._scaling.temperature_degc(counts[:, 6])
        self.samples += len(stamps)
        self.first_stamp_ns = int(stamps_ns[0]) if self.first_stamp_ns is None else self.first_stamp_ns
        self.rate.add(stamps.tolist())
        self.history.add_temperature((stamps_ns - self.first_stamp_ns) / 1e9, degc)
        if self._writer is not None:
            imus = schemas.encode_imus(stamps_ns, gyro, accel, valid)
            temperatures = schemas.encode_temperatures(stamps_ns, degc)
            for k, imu, temperature, stamp_ns in zip(
                places.tolist(), imus, temperatures, stamps_ns.tolist(), strict=True
            ):
                log_ns = self._timebase.utc_ns(arrived[k][2])
                messages[k] += (
                    (schemas.IMU, imu, log_ns, stamp_ns),
                    (schemas.TEMPERATURE, temperature, log_ns, stamp_ns),
                )
        if self.filter is not None:
            found = self.filter.samples(stamps_ns[valid], gyro[valid], accel[valid], degc[valid])
            for stamp_ns, message in found:
                k = int(places[min(int(np.searchsorted(stamps_ns, stamp_ns)), len(places) - 1)])
                messages[k].append((schemas.ESTIMATE, message, self._timebase.utc_ns(arrived[k][2]), stamp_ns))

    def _write(self, messages: Iterable[Iterable[Encoded]]) -> None:
        if self._writer is not None:
            self._writer.all_encoded(chain.from_iterable(messages))

    def news(self) -> Iterator[tuple[str, str]]:
        """Causes that the filter's watch tells or withdraws: names and texts of events."""
        return iter(()) if self.filter is None else self.filter.news()

    def event(self, name: str, text: str, now_ns: int, level: int = 20) -> None:
        """Write a mark, a remark or an event, if recording."""
        utc = self._timebase.utc_ns(now_ns)
        self.marks += name in ("mark", "remark")
        if name == "mark" and self.filter is not None:
            self.filter.mark(utc, text)
        if self._writer is not None:
            self._writer.encoded(schemas.EVENTS, schemas.encode_event(utc, name, text, level), utc, utc)

    def table_states(self, states: Iterable[TableState], now_ns: int) -> None:
        """Write what the controller of a table said; raises OSError."""
        if self._writer is not None:
            log_ns, offset = self._timebase.utc_ns(now_ns), self._timebase.utc_ns(0)
            self._writer.all_encoded(
                (schemas.STATE, schemas.encode_table_state(stamp_ns, *told), log_ns, stamp_ns)
                for stamp_ns, *told in ((offset + s.stamp_ns, *astuple(s)[1:]) for s in states)
            )

    def flush(self, now_ns: int) -> None:
        """Write reference and diagnostics, and see everything onto the disk; raises OSError if it is not taken."""
        if self._writer is None:
            return
        utc = self._timebase.utc_ns(now_ns)
        angles = np.zeros(3) if self.info.reference == "level" else np.full(3, np.nan)
        rates = np.zeros(3) if self.info.reference in _STILL else np.full(3, np.nan)
        (reference,) = schemas.encode_table_references(utc, self.info.reference, angles, rates)
        self._writer.encoded(schemas.REFERENCE, reference, utc, utc)
        damaged = self.counters.lost_packets_max or self.counters.bad_checksums
        found = ["packets were lost or damaged"] if damaged else []
        if self.info.sampling == "polled" and polled_rate.finding(self.info.rate_hz, self.rate.hz()) is not None:
            found.append("the asked rate is not kept")
        level, text = int(bool(found)), "; ".join(found) or "ok"
        values = self._diagnostics(now_ns)
        self._writer.encoded(schemas.DIAGNOSTICS, schemas.encode_diagnostics(utc, level, text, values), utc, utc)
        self._uncertainty_ns = 0
        self._flush()

    def _flush(self) -> None:
        if self._writer is not None:
            self._writer.flush()
            self.flushed_ns = time.monotonic_ns()

    def _diagnostics(self, now_ns: int) -> dict[str, str]:
        age = (now_ns - self.flushed_ns) / 1e9 if self.flushed_ns is not None else 0.0
        hz = self.rate.hz()
        return {
            "serial_number": self.info.serial_number,
            "rate_asked_hz": repr(self.info.rate_hz),
            "rate_measured_hz": "" if hz is None else f"{hz:.4f}",
            "packets": str(self.counters.packets),
            "samples": str(self.samples),
            "lost_packets": str(self.counters.lost_packets),
            "lost_packets_max": str(self.counters.lost_packets_max),
            "bad_checksums": str(self.counters.bad_checksums),
            "resynchronised_bytes": str(self.counters.discarded_bytes),
            "doubled_packets": str(self.counters.doubled_packets),
            "stamp_uncertainty_ms": f"{self._uncertainty_ns / 1e6:.3f}" if self._uncertainty_ns else "",
            "flush_age_s": f"{age:.3f}",
            **self._description,
        }

    def describe(self, info: SessionInfo) -> None:
        """Take metadata whose note or operator has changed; each second of the file says them from now on."""
        self.info = info
        self._description = {key: getattr(info, key) for key in schemas.DESCRIPTION}
        if self._writer is not None:
            self._writer.describe(info)

    def utc_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic instant, ns."""
        return self._timebase.utc_ns(monotonic_ns)

    def use_waiting(self, now_ns: int) -> None:
        """Filter the samples that still wait: the file ends here."""
        if self.filter is not None:
            utc = self._timebase.utc_ns(now_ns)
            self._write([[(schemas.ESTIMATE, message, utc, stamp_ns)] for stamp_ns, message in self.filter.finish()])

    def release_file(self) -> None:
        """Go on without the file, which is finished."""
        self._writer = None
