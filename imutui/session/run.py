"""One run of samples: packets to the disk first, then averaged to samples, then through the filter.

A new recording begins a new run, so that the file holds every sample that its filter has seen and a replay gives the
same estimates. There is a run without a file as well: viewers see readings and estimates before anything is recorded.
"""

import contextlib
import time
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from filters.health.finding import HealthEntry
from filters.health.monitor import HealthMonitor
from filters.kalman.augmentation import MakeEffects
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.instrument.driver import Driver
from imutui.instrument.names import DEFAULT
from imutui.instrument.registry import INSTRUMENTS
from imutui.logbook import health, polled_rate, schemas
from imutui.logbook.log_time import Timebase
from imutui.logbook.samples import SampleGroups, Samples
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import Encoded, LogWriter
from imutui.session.live_filter import LiveFilter, RunHistory
from imutui.session.stream import INFORMATION, WARNING, Block, Broke, Event, Said, Second, Why
from imutui.table.motion import TableState
from imutui.verdict import sources

if TYPE_CHECKING:
    from imutui.logbook.results import RunDocument

_RATE_SPAN_NS = 10_000_000_000
_STILL = ("level", "gravity")  # references by which the table stands


@dataclass(slots=True)
class LineCounters:
    """Packets and damage of the line since the run began.

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
        """Add the stamps of samples."""
        self.stamps += stamps_ns
        since = bisect_left(self.stamps, self.stamps[-1] - _RATE_SPAN_NS, 1)
        del self.stamps[: max(0, min(since - 1, len(self.stamps) - 3))]

    def hz(self) -> float | None:
        """Return the rate, or None before there are three samples."""
        if len(self.stamps) < 3:
            return None
        return (len(self.stamps) - 1) * 1e9 / (self.stamps[-1] - self.stamps[0])


class Run:
    """Takes packets; writes raw packets, samples and estimates to the file (`writer`), if there is one.

    `motion` is what the filter's reference needs, `effects` makes the effects that join the filter.
    Raises InputError if the filter's settings are refused.
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
        self.counters = LineCounters()
        self.samples = self.marks = 0
        self.rate = SampleRate()
        self.health: list[HealthEntry] = []  # faults of the channels as of the last second
        self.started_ns: int | None = None  # when the first packet was sampled, monotonic
        self.flushed_ns: int | None = None  # time of the last flush to the disk, monotonic
        self.first_stamp_ns: int | None = None  # sampling instant of the first sample, UTC
        self.history = RunHistory()
        self.filter = LiveFilter(info, motion, effects, self.history.estimates) if info.filter != "none" else None
        self._writer = writer
        self._timebase = timebase
        self._axes = info.axes()
        self._count_limits = instrument.count_limits
        self._has_details = instrument.status_names is not None
        self._scaling = instrument.scaling(info.rate_range_dps, info.accel_range_g)
        self._readings = health.Readings(self._scaling, info.g_unit)
        self._monitor = HealthMonitor(health.expected(info, self._readings.lsb))
        self._description: dict[str, str] = {}
        self._uncertainty_ns = 0  # the largest since it was last written
        # of a unit that is polled, or streams at the rate that is asked, each packet is a sample
        each = info.sampling != "stream" or instrument.gives(info.rate_hz)
        self._groups = SampleGroups(info.rate_hz, each=each)

    def take(self, event: Event) -> None:
        """Take an event of the stream. Raises OSError."""
        match event:
            case Block():
                self._take_block(event)
            case Broke(Why.UNANSWERED):
                self.counters.lost_packets += 1
                self.counters.lost_packets_max += 1
            case Said():
                self._write_event(event)
            case Second():
                self.flush(event.written_ns)

    # -- packets ------------------------------------------------------------------------------------------------------

    def _take_block(self, block: Block) -> None:
        """Take packets. Messages are in the order in which they would come of one packet after the other."""
        counters, gap = self.counters, block.gap
        counters.bad_checksums += block.bad_checksums
        counters.discarded_bytes += block.discarded_bytes
        counters.doubled_packets += block.doubled
        if gap is not None:
            counters.lost_packets += gap.lost_min
            counters.lost_packets_max += gap.lost_max
        if self.started_ns is None:
            # the first packet is on the disk before the filter is loaded, which takes its time
            self.started_ns = int(block.rows["stamp_ns"][0])
            first, block = block.cut(1)
            self._take_rows(first.rows, lost_before=gap is not None, is_first=True)
        if block.rows.size:
            self._take_rows(block.rows, lost_before=block.gap is not None)

    def _take_rows(self, rows: np.ndarray, *, lost_before: bool, is_first: bool = False) -> None:
        least, most = self._count_limits
        counts, stamps = rows["counts"], rows["stamp_ns"]
        at_limit = np.any((counts[:, :6] == least) | (counts[:, :6] == most), axis=1)
        self._uncertainty_ns = max(self._uncertainty_ns, int(rows["uncertainty_ns"].max()))
        self._monitor.add((stamps - self.started_ns) / 1e9, *self._readings.of(counts))
        messages = self._raws(rows, at_limit, lost_before=lost_before)
        self.counters.packets += rows.size
        if is_first:
            self._write(messages)
            self._flush()
            messages = [[]]
        done = self._groups.take(stamps, counts.astype(float), ~at_limit)
        if done[0].size:
            self._take_samples(*done, (rows["host_ns"] + self._timebase.utc_ns(0)).tolist(), messages)
        self._write(messages)

    def _raws(self, rows: np.ndarray, at_limit: np.ndarray, *, lost_before: bool) -> list[list[Encoded]]:
        """Return a list for the messages of each packet, which begins with the packet as it came."""
        if self._writer is None:
            return [[] for _ in rows]
        offset = self._timebase.utc_ns(0)
        raws = np.zeros(rows.size, schemas.RAW_DTYPE)
        raws["sequence"] = np.arange(self.counters.packets, self.counters.packets + rows.size)
        raws["host_monotonic_ns"] = rows["host_ns"]
        raws["counts"], raws["temperature"] = rows["counts"][:, :6], rows["counts"][:, 6] % 65536
        raws["flags"] = schemas.FLAG_HOST_STAMP * rows["by_host"] | schemas.FLAG_LIMIT * at_limit
        raws["flags"][0] |= schemas.FLAG_LOST_BEFORE * lost_before
        for name in ("ticks", "rate_temperatures", "board_temperature", "status"):
            raws[name] = rows[name]
        data = schemas.encode_raws(raws, details=self._has_details)
        log_ns, stamps_ns = (rows["host_ns"] + offset).tolist(), (rows["stamp_ns"] + offset).tolist()
        return [[(schemas.RAW, *message)] for message in zip(data, log_ns, stamps_ns, strict=True)]

    def _take_samples(
        self,
        places: np.ndarray,
        stamps: np.ndarray,
        counts: np.ndarray,
        valid: np.ndarray,
        log_ns: list[int],
        messages: list[list[Encoded]],
    ) -> None:
        """Use samples: which packets complete them, their stamps, mean readings, validity.

        Their messages go behind those of these packets, `messages`, at the packets' log times.
        """
        samples = Samples(
            self._timebase.utc_ns(0) + stamps,
            self._axes.gyro_to_body(np.deg2rad(self._scaling.rates_dps(counts[:, :3]))),
            self._axes.accel_to_body(self._scaling.accels_g(counts[:, 3:6]) * self.info.g_unit),
            valid,
            self._scaling.temperature_degc(counts[:, 6]),
        )
        stamps_ns = samples.stamp_ns
        self.samples += len(samples)
        self.first_stamp_ns = int(stamps_ns[0]) if self.first_stamp_ns is None else self.first_stamp_ns
        self.rate.add(stamps.tolist())
        self.history.add_temperature((stamps_ns - self.first_stamp_ns) / 1e9, samples.degc)
        if self._writer is not None:
            imus = schemas.encode_imus(stamps_ns, samples.gyro, samples.accel, valid)
            temperatures = schemas.encode_temperatures(stamps_ns, samples.degc)
            for k, imu, temperature, stamp_ns in zip(
                places.tolist(), imus, temperatures, stamps_ns.tolist(), strict=True
            ):
                messages[k] += (
                    (schemas.IMU, imu, log_ns[k], stamp_ns),
                    (schemas.TEMPERATURE, temperature, log_ns[k], stamp_ns),
                )
        if self.filter is not None:
            for stamp_ns, message in self.filter.samples(samples.rows(valid)):
                k = int(places[min(int(np.searchsorted(stamps_ns, stamp_ns)), len(places) - 1)])
                messages[k].append((schemas.ESTIMATE, message, log_ns[k], stamp_ns))

    def _write(self, messages: Iterable[Iterable[Encoded]]) -> None:
        if self._writer is not None:
            self._writer.all_encoded(chain.from_iterable(messages))

    # -- events -------------------------------------------------------------------------------------------------------

    def news(self) -> Iterator[Said]:
        """Look for faults of the channels and causes in the residual; yield those that are new or withdrawn."""
        known = {(entry["channel"], entry["kind"]) for entry in self.health}
        self.health = self._channel_faults()
        for entry in self.health:
            if (entry["channel"], entry["kind"]) not in known:
                yield Said("health", entry["said"], WARNING)
        for name, text in () if self.filter is None else self.filter.news():
            yield Said(name, text, WARNING if name == "cause" else INFORMATION)

    def _channel_faults(self, *, final: bool = False) -> list[HealthEntry]:
        """Return the faults of the channels over all packets so far; `final` as in `HealthMonitor.findings`."""
        live = self.filter
        estimator = None if live is None or live.failure is not None else live.estimator
        sd, moving = health.bias_sd(estimator, self.info), not self.info.effects_sha256
        return health.entries(self._monitor.findings(sd, moving=moving, final=final))

    def _write_event(self, said: Said) -> None:
        utc = self.utc_ns(said.at_ns)
        self.marks += said.name in ("mark", "remark")
        if said.name == "mark" and self.filter is not None:
            self.filter.mark(utc, said.text)
        if self._writer is not None:
            data = schemas.encode_event(utc, said.name, said.text, said.level)
            self._writer.encoded(schemas.EVENTS, data, utc, utc)

    def table_states(self, states: Iterable[TableState], now_ns: int) -> None:
        """Write the reports of a table's controller; raises OSError."""
        if self._writer is not None:
            log_ns, offset = self.utc_ns(now_ns), self.utc_ns(0)
            self._writer.all_encoded(
                (schemas.STATE, schemas.encode_table_state(stamp_ns, *state), log_ns, stamp_ns)
                for stamp_ns, *state in ((offset + s.stamp_ns, *astuple(s)[1:]) for s in states)
            )

    # -- the file -----------------------------------------------------------------------------------------------------

    def flush(self, now_ns: int) -> None:
        """Write reference and diagnostics, and flush to the disk; raises OSError."""
        if self._writer is None:
            return
        utc = self.utc_ns(now_ns)
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
        """Take metadata whose note or operator has changed; each second of the file has them from now on."""
        self.info = info
        self._description = {key: getattr(info, key) for key in schemas.DESCRIPTION}
        if self._writer is not None:
            self._writer.describe(info)

    def utc_ns(self, monotonic_ns: int) -> int:
        """Return the UTC of a monotonic instant, ns."""
        return self._timebase.utc_ns(monotonic_ns)

    def finish(self, now_ns: int) -> "RunDocument":
        """Filter the samples that wait, finish the file and return its result; the run goes on without a file.

        Raises OSError if the disk refuses the end; the file then ends with its last flush.
        """
        self._use_waiting(now_ns)
        self.flush(now_ns)
        return self.close(now_ns)

    def close(self, now_ns: int) -> "RunDocument":
        """Finish the file with the estimates so far, and return its result. Raises OSError as `finish` does."""
        writer = self._writer
        assert writer is not None
        document = self._result(writer.path, None)
        # of its result the file keeps all, and the verdict on it in a word
        writer.finish({**document, "verdict": sources.of_document(document).word}, self.utc_ns(now_ns))
        self._writer = None
        return self._result(writer.path, writer.sha256)

    def give_up(self, now_ns: int) -> "RunDocument":
        """Return the result of a run whose file is out of reach, and go on without it; `finished` is False.

        The file is finished where it is now, if its disk takes it.
        """
        writer = self._writer
        assert writer is not None
        with contextlib.suppress(OSError):
            self.close(now_ns)
        self._writer = None
        self._use_waiting(now_ns)
        result = self._result(writer.path, None)
        result["finished"] = False
        return result

    def _use_waiting(self, now_ns: int) -> None:
        if self.filter is not None:
            utc = self.utc_ns(now_ns)
            self._write([[(schemas.ESTIMATE, message, utc, stamp_ns)] for stamp_ns, message in self.filter.finish()])

    def _result(self, path: Path, log_sha256: str | None) -> "RunDocument":
        # loads statistics: not before a recording ends
        from imutui.logbook import results

        lost, live = (self.counters.lost_packets, self.counters.bad_checksums), self.filter
        faults = self._channel_faults(final=True)
        result: RunDocument = results.of_readings(self.info, path, self.samples, lost, faults, log_sha256)
        if live is not None and live.estimator is not None and live.estimator.latest is not None:
            result = results.document(result, live.estimator, self.info, live.seconds, 0.0)
        if live is not None and live.failure is not None:
            result["alarms"].append(live.failure)
        return result
