"""One take: a run of output samples, to the disk first and then through the filter.

Starting to record starts a new take, so that the file holds every sample that its filter has seen and a replay
gives the same estimates.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from filters.kalman.augmentation import MakeEffects
from filters.kalman.runner import Estimator
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.instrument.clock import Stamp
from imutui.instrument.crossbow import Packet, Scaling
from imutui.logbook import reader, results, schemas
from imutui.logbook.results import Counters, Timings
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session.averaging import Averager, Sample
from imutui.session.live_filter import LiveFilter

_LIMIT_COUNTS = (-32768, 32767)


@dataclass(slots=True)
class Tally:
    """Line counters since the take began."""

    packets: int = 0
    lost_packets: int = 0
    bad_checksums: int = 0
    discarded_bytes: int = 0


@dataclass(frozen=True, slots=True)
class Timebase:
    """UTC at start plus the monotonic clock: steps of the system's clock never reach a log."""

    utc_minus_monotonic_ns: int

    def utc_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic instant, ns."""
        return monotonic_ns + self.utc_minus_monotonic_ns


@dataclass(slots=True)
class _Rate:
    """Samples a second over the last 10 s (at least two samples)."""

    stamps: list[int] = field(default_factory=list)

    def add(self, stamp_ns: int) -> None:
        """Take a sample's stamp."""
        self.stamps.append(stamp_ns)
        while len(self.stamps) > 3 and stamp_ns - self.stamps[1] > 10_000_000_000:
            self.stamps.pop(0)

    def hz(self) -> float | None:
        """Rate, or None before there are three samples."""
        if len(self.stamps) < 3:
            return None
        return (len(self.stamps) - 1) * 1e9 / (self.stamps[-1] - self.stamps[0])


class Take:
    """Samples, filter and, if recording, the file.

    Parameters
    ----------
    info : SessionInfo
        Of this take.
    timebase : Timebase
        Monotonic to UTC.
    writer : LogWriter or None
        None when not recording.
    motion : Profile, Trajectory or None
        What the filter's reference needs.
    effects : callable or None
        Makes the effects that join the filter.
    """

    def __init__(
        self,
        info: SessionInfo,
        timebase: Timebase,
        writer: LogWriter | None,
        motion: Profile | Trajectory | None = None,
        effects: MakeEffects | None = None,
    ) -> None:
        self.info = info
        self.writer = writer
        self.tally = Tally()
        self.samples = 0
        self.marks = 0
        self.rate = _Rate()
        self.started_ns: int | None = None
        self.flushed_ns: int | None = None
        self.filter = LiveFilter(info, motion, effects) if info.filter != "none" else None
        self._timebase = timebase
        self._axes = info.axes()
        self._scaling = Scaling(info.rate_range_dps, info.accel_range_g)
        self._limited = False
        self._averager = Averager(info.rate_hz) if info.sampling == "stream" else None

    @property
    def estimator(self) -> Estimator | None:
        """The filter's, if there is one."""
        return None if self.filter is None else self.filter.estimator

    @property
    def failure(self) -> str | None:
        """Why the filter stopped, if it did."""
        return None if self.filter is None else self.filter.failure

    def packet(self, packet: Packet, stamp: Stamp, host_ns: int) -> None:
        """Take a packet; raises OSError if the disk does not take it."""
        counts = (*packet.rates, *packet.accels)
        limited = any(n in _LIMIT_COUNTS for n in counts)
        if self.started_ns is None:
            self.started_ns = stamp.monotonic_ns
        if self.writer is not None:
            self._write_raw(packet, counts, stamp, host_ns)
        self.tally.packets += 1
        self.tally.lost_packets += stamp.lost
        if self._averager is None:
            values = np.array(counts, float)
            self._sample(Sample(stamp.monotonic_ns, values, float(packet.temperature), 1), host_ns, valid=not limited)
        else:
            sample = self._averager.add(stamp.monotonic_ns, counts, packet.temperature)
            if sample is not None:
                self._sample(sample, host_ns, valid=not self._limited)
                self._limited = False
            self._limited |= limited

    def _write_raw(self, packet: Packet, counts: tuple[int, ...], stamp: Stamp, host_ns: int) -> None:
        assert self.writer is not None
        a, b, c, d, e, f = counts
        flags = schemas.FLAG_LOST_BEFORE if stamp.lost else 0
        flags |= schemas.FLAG_HOST_STAMP if stamp.by_host else 0
        flags |= schemas.FLAG_LIMIT if any(n in _LIMIT_COUNTS for n in counts) else 0
        raw = schemas.RawPacket(
            self.tally.packets, host_ns, (a, b, c, d, e, f), packet.temperature, packet.ticks, 0, flags
        )
        self.writer.raw(raw, self._timebase.utc_ns(host_ns), self._timebase.utc_ns(stamp.monotonic_ns))

    def _sample(self, sample: Sample, host_ns: int, *, valid: bool) -> None:
        stamp_ns = self._timebase.utc_ns(sample.stamp_ns)
        gyro = self._axes.gyro_to_body(np.deg2rad(self._scaling.rates_dps(sample.counts[:3])))
        accel = self._axes.accel_to_body(self._scaling.accels_g(sample.counts[3:]) * self.info.g_unit)
        self.samples += 1
        self.rate.add(sample.stamp_ns)
        degc = float(self._scaling.temperature_degc(sample.temperature))
        if self.writer is not None:
            log_ns = self._timebase.utc_ns(host_ns)
            self.writer.imu(log_ns, stamp_ns, gyro, accel, valid=valid)
            self.writer.message(schemas.TEMPERATURE, schemas.temperature(stamp_ns, degc), log_ns, stamp_ns)
        # a count at its limit says only "this or more": the filter predicts through it
        if self.filter is not None and valid:
            self._filter(self.filter.sample(stamp_ns, gyro, accel, degc), host_ns)

    def _filter(self, messages: Iterator[tuple[int, bytes]], host_ns: int) -> None:
        for stamp_ns, message in messages:
            if self.writer is not None:
                self.writer.encoded(schemas.ESTIMATE, message, self._timebase.utc_ns(host_ns), stamp_ns)

    def event(self, name: str, text: str, now_ns: int, level: int = 20) -> None:
        """Write a mark, a remark or an event, if recording."""
        utc = self._timebase.utc_ns(now_ns)
        self.marks += name in ("mark", "remark")
        if name == "mark" and self.filter is not None:
            self.filter.mark(utc, text)
        if self.writer is not None:
            self.writer.message(schemas.EVENTS, schemas.event(utc, name, text, level), utc, utc)

    def every_second(self, now_ns: int) -> None:
        """Reference, diagnostics, and everything onto the disk."""
        if self.writer is None:
            return
        utc = self._timebase.utc_ns(now_ns)
        angles = np.zeros(3) if self.info.reference == "level" else np.full(3, np.nan)
        reference = schemas.table_reference(utc, self.info.reference, angles, np.zeros(3))
        self.writer.message(schemas.REFERENCE, reference, utc, utc)
        level = 1 if self.tally.lost_packets or self.tally.bad_checksums else 0
        text = "packets were lost or damaged" if level else "ok"
        values = self._diagnostics(now_ns)
        self.writer.message(schemas.DIAGNOSTICS, schemas.diagnostics(utc, level, text, values), utc, utc)
        self.writer.flush()
        self.flushed_ns = time.monotonic_ns()

    def _diagnostics(self, now_ns: int) -> dict[str, str]:
        age = (now_ns - self.flushed_ns) / 1e9 if self.flushed_ns is not None else 0.0
        hz = self.rate.hz()
        return {
            "serial_number": self.info.serial_number,
            "rate_asked_hz": repr(self.info.rate_hz),
            "rate_measured_hz": "" if hz is None else f"{hz:.4f}",
            "packets": str(self.tally.packets),
            "samples": str(self.samples),
            "lost_packets": str(self.tally.lost_packets),
            "bad_checksums": str(self.tally.bad_checksums),
            "resynchronised_bytes": str(self.tally.discarded_bytes),
            "flush_age_s": f"{age:.3f}",
        }

    def finish(self, now_ns: int) -> dict[str, Any] | None:
        """Use what still waits, close the file and return the result document; None when not recording.

        Raises
        ------
        OSError
            If the disk does not take the end; the file then ends with its last flush.
        """
        if self.writer is None:
            return None
        if self.filter is not None:
            self._filter(self.filter.finish(), now_ns)
        self.every_second(now_ns)
        summary = self._document(None)
        self.writer.finish(summary, self._timebase.utc_ns(now_ns))
        return self._document(reader.sha256(self.writer.path))

    def _document(self, sha256: str | None) -> dict[str, Any]:
        assert self.writer is not None
        counters = Counters(self.tally.lost_packets, self.tally.bad_checksums)
        timings = Timings(0.0 if self.filter is None else self.filter.seconds, 0.0)
        path: Path = self.writer.path
        if self.estimator is None or self.estimator.latest is None:
            return {
                "version": results.VERSION,
                "log": str(path.resolve()),
                "kind": self.info.kind,
                "filter": self.info.filter,
                "samples": self.samples,
                "finished": True,
                "lost_packets": counters.lost_packets,
                "bad_checksums": counters.bad_checksums,
                "alarms": [] if self.failure is None else [self.failure],
                "log_sha256": sha256,
            }
        document = results.document(
            self.estimator, self.info, path, finished=True, counters=counters, timings=timings, log_sha256=sha256 or ""
        )
        document["log_sha256"] = sha256
        if self.failure is not None:
            document["alarms"].append(self.failure)
        return document
