"""An acquisition that is not there: canned snapshots, a moving series, and a diary of what was asked."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from helpers.shapes import whole
from imutui.estimate_history import HistorySnapshot
from imutui.estimates import Bias, FilterSnapshot, live_biases
from imutui.logbook.results import ReadingsDocument, RunDocument
from imutui.session.client import EndReport, SessionError, SessionGoneError
from imutui.session.lifecycle import Lifecycle
from imutui.session.plan import HistoryWish, RecordingWish
from imutui.session.snapshot import (
    ControllerSnapshot,
    GuideSnapshot,
    MarkLine,
    ProfileDescription,
    RecordingSnapshot,
    Snapshot,
    StatisticsSnapshot,
)

if TYPE_CHECKING:
    from imutui.session.channel_statistics import ChannelStatistics
    from imutui.session.live_filter import RunHistory

RATE_HZ = 133.0
MEANS = np.array([0.3461, -0.4702, -0.2688, -6.112, -0.402, 1000.981, 24.96])
SDS = np.array([0.1492, 0.1507, 0.1485, 1.931, 1.928, 1.934, 0.018])
UNITS = ("deg/s",) * 3 + ("mg",) * 3 + ("degC",)
NAMES = ("gx", "gy", "gz", "ax", "ay", "az", "T")
PATH = "/data/logs/imu400cd_9911750_20261121T104307Z.mcap"


def bias(name: str, value: float | None, sd3: float | None, **changes: Any) -> Bias:
    """One of the filter's biases, and three standard deviations of it."""
    gyro, sd = name.endswith("gyro"), None if sd3 is None else sd3 / 3.0
    known = next(one for one in live_biases(_estimates()) if one.name == name)
    known = known._replace(change_10s=0.0004 if gyro else -0.02, converged_s=9.8, observable=True, site_sd=0.0)
    return known._replace(**{"value": value, "sd": sd, **changes})


def estimates(biases: Sequence[Bias] = (), **changes: Any) -> FilterSnapshot:
    """A filter that waits for one bias only, or has other biases."""
    given = biases or [
        bias("x gyro", 0.3461, 0.0291),
        bias("y gyro", -0.4702, 0.0291, change_10s=-0.0011),
        bias("z gyro", -0.2688, 0.21, converged_s=None, change_10s=None),
        bias("x accel", -6.11, 0.67),
        bias("y accel", -0.40, 0.67, change_10s=0.01),
        bias("z accel", 3.05, 0.67),
    ]
    found = cast("FilterSnapshot", {**_estimates(), **changes})
    found["unobservable"] = [f"{one.key.rpartition('_')[0]}_{'xyz'[one.place]}" for one in given if not one.observable]
    for one in given:
        since = found["converged_s"]["gyro_bias" if one.channel[0] == "g" else "accel_bias"]
        since[one.place] = one.converged_s
        for field, value in ((found["final"], one.value), (found["sd"], one.sd), (found["change_10s"], one.change_10s)):
            field[one.key][one.place] = value
        if one.unit == "mg":
            found["site_sd_mg"][one.place] = one.site_sd
    return found


def _estimates() -> FilterSnapshot:
    """The same before it is said what its biases are."""
    final = {"position_deg_m": [-23.211323, -45.859176, 641.2], "velocity_mps": [0.0, 0.001, -0.0002],
             "rpy_deg": [0.002, -0.001, 0.003]}  # fmt: skip
    sd = {
        "position_m": [0.13, 0.13, 0.37],
        "velocity_mps": [0.0027, 0.0027, 0.001],
        "rpy_deg": [0.0057, 0.0057, 0.0127],
    }
    ratios = {"gx": 0.9, "gy": 1.1, "gz": 2.1, "ax": 1.0, "ay": 0.8, "az": 1.2}
    why = "the reference is fed exact, not drawn from R: NIS is far below its degrees of freedom by construction"
    return cast("FilterSnapshot", whole(
        FilterSnapshot, identity={"instrument": "IMU400CD-200"}, filter="spkf", reference="level", duration_s=12.3,
        samples=246, site_stated=True, final=final, sd=sd, temperature_k_per_min=0.0,
        nis={"mean": 0.24, "first": 0.001, "dof": 9, "band95": [8.9, 9.1], "is_test": False, "why": why},
        remainder=[{"channel": name, "ratio": ratio, "windows": 6} for name, ratio in ratios.items()],
    ))  # fmt: skip


def _counted(values: np.ndarray) -> "ChannelStatistics":
    from imutui.instrument.imu400.scaling import scaling as imu400cd_scaling
    from imutui.session.channel_statistics import ChannelStatistics

    scaling = imu400cd_scaling()
    counted = ChannelStatistics(scaling)
    vibration = 0.2 * np.sin(2.0 * np.pi * 16.0 / RATE_HZ * np.arange(len(values)))
    counts = np.hstack(
        [
            scaling.rate_counts(values[:, :3] + vibration[:, None]),
            scaling.accel_counts(1e-3 * values[:, 3:6]),
            scaling.temperature_counts(values[:, 6:]),
        ]
    )
    counted.add(np.arange(len(values)) / RATE_HZ, counts)
    return counted


def result(**fields: Any) -> RunDocument:
    """Of a recording without a filter."""
    return cast("RunDocument", whole(ReadingsDocument, log=PATH, samples=15246, **fields))


class FakeClient:
    """Has the methods of `imutui.session.client.Client`.

    `name`, `kind`: of the acquisition; where its readings come from.
    `history_s`: how long it has been running.
    `clock`: seconds; the host's unless a test has one that it sets, for a screen that is always the same.
    """

    def __init__(
        self,
        name: str = "default",
        kind: str = "simulated",
        history_s: float = 20.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = name
        self.pid = 4711
        self.asked: list[str] = []
        self.recording = False
        self.closed = False
        self.polls = 0
        self.changes: dict[str, Any] = {"kind": kind}
        """Fields of the snapshot that a test wants otherwise."""
        self.past: RunHistory | None = None
        """What the acquisition keeps of its run; None for what its snapshots had."""
        self._gathered: RunHistory | None = None
        self.counted: ChannelStatistics | None = None
        """What the acquisition has worked out of its packets; made when it is first asked for."""
        self.gone: str | None = None
        self.report: EndReport | None = None
        self.marks: list[MarkLine] = [{"t": 3.2, "utc": "10:30:30", "text": "door closed"}]
        self.wish: RecordingWish | None = None
        self.table_profile: ProfileDescription | None = None
        self._clock = clock
        self._born = clock() - history_s
        self._sent = 0
        self._noise = np.random.default_rng(1).standard_normal((4096, 7))
        self._lock = threading.Lock()

    def snapshot(self, since: int = 0) -> Snapshot:
        with self._lock:
            if self.gone is not None:
                # a process that is gone, or one that does not answer
                raise (SessionGoneError if "has ended" in self.gone else SessionError)(self.gone)
            self.polls += 1
            made = cast("Snapshot", {**self._snapshot(since), **self.changes})
            made["guide"] = made["guide"] and whole(GuideSnapshot, made["guide"])
            made["controller"] = made["controller"] and whole(ControllerSnapshot, made["controller"])
            self._gather(made["filter"])
            return made

    def history(self, wish: HistoryWish) -> HistorySnapshot:
        """The past that a test gave it, or that its snapshots had."""
        with self._lock:
            past = self.past or self._gathered
            assert past is not None
            return past.piece(1, wish)

    def _gather(self, found: FilterSnapshot | None) -> None:
        from imutui.session.live_filter import RunHistory

        self._gathered = self._gathered or RunHistory()
        if found is not None and found["samples"] and not found["waiting"]:
            biases = live_biases(found)
            values, sd3 = (
                np.array(each, float) for each in zip(*((one.value, one.sd3) for one in biases), strict=True)
            )
            converged = np.array([one.converged_s is not None for one in biases])
            self._gathered.estimates.add(found["duration_s"], values, sd3, converged)

    def _snapshot(self, since: int) -> Snapshot:
        seconds = self._clock() - self._born
        count = int(seconds * RATE_HZ)
        numbers = np.arange(max(since, count - 4000, 0), count)
        values = MEANS + SDS * self._noise[numbers % 4096]
        newest = MEANS + SDS * self._noise[max(count - 1, 0) % 4096]
        return {
            "name": self.name, "batch": "", "owner": "ana on bench", "site_stated": True, "doubled_packets": 0,
            "status": "", "next_note": self.changes.get("note", ""), "ends_unwatched_s": None,
            "controller": None,
            "pid": self.pid, "state": "running", "error": None, "findings": [],
            "ended_by": "",
            "instrument": "IMU400CD-200",
            "serial_number": "9911750", "firmware": "IMU400CD 1.2", "kind": "simulated",
            "port": "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A9-if00-port0", "baud": 38400, "rate_hz": 20.0,
            "sampling": "stream", "measured_hz": 20.001, "packet_hz": 133.31, "packets": count, "lost_packets": 0,
            "lost_packets_max": 0,
            "bad_checksums": 0, "discarded_bytes": 0, "health": [],
            "advice": {"losses": "check the cable", "silence": "check power and cable"}, "silent_s": 0.005,
            "zeroing": False, "reconnecting": None, "since_start_s": 192.0 + seconds,
            "utc": "2026-11-21T10:43:07Z",
            "recording": self._recording(seconds) if self.recording else None,
            "channels": [
                {"name": n, "counts": int(38 * (i + 1)), "value": float(newest[i]) if count else None, "unit": u,
                 "mean": float(MEANS[i]), "sd": float(SDS[i]), "min": float(MEANS[i] - 3 * SDS[i]),
                 "max": float(MEANS[i] + 3 * SDS[i])}
                for i, (n, u) in enumerate(zip(NAMES, UNITS, strict=True))
            ],
            "statistics_s": 10.0, "filter": estimates(duration_s=seconds),
            "free_bytes": 52_000_000_000, "min_free_bytes": 200_000_000,
            "operator": "ana", "place": "lab 2", "table": "AC-120", "note": "",
            "rotate_minutes": 0.0, "rotate_mb": 0.0, "logs": "/data/logs", "marks": self.marks,
            "reference": {"name": "level", "file": "", "profile": False}, "effects": [], "guide": None,
            "events": [{"utc": "10:42:00", "name": "acquisition", "text": "started at 20 Hz"}],
            "series": {"next": count, "t": (numbers / RATE_HZ).tolist(), "values": values.tolist()},
        }  # fmt: skip

    def _recording(self, seconds: float) -> RecordingSnapshot:
        return {
            "path": PATH,
            "bytes": 123456,
            "seconds": 761.0 + seconds,
            "samples": 15246,
            "flush_age_s": 0.4,
            "marks": 1,
            "bytes_per_s": 6100.0,
            "to_full_s": 8_500_000.0,
            "part": 1,
        }

    def statistics(self, channel: int) -> StatisticsSnapshot:
        """Of half a minute of readings, with a vibration of the gyros at 16 Hz."""
        if self.counted is None:
            self.counted = _counted(MEANS + SDS * self._noise)
        return self.counted.snapshot(channel, len(self._noise) / RATE_HZ)

    def begin_statistics(self) -> None:
        self.asked.append("begin statistics")

    def mark(self, text: str) -> None:
        self.asked.append(f"mark {text}")

    def describe(self, note: str | None = None, operator: str | None = None) -> None:
        """Note it, and have it from now on."""
        self.asked.append(f"describe {note} {operator}")
        self.changes |= {key: text for key, text in (("note", note), ("operator", operator)) if text is not None}

    def record(self, wish: RecordingWish | None = None) -> str:
        self.asked.append("record")
        self.wish = wish
        self.recording = True
        return PATH

    def configure(self, **changes: Any) -> None:
        """Note what was changed."""
        self.asked.append(f"configure {' '.join(sorted(changes))}")

    def zero(self, argument: int) -> str:
        self.asked.append(f"zero {argument}")
        return "rate sensors zeroed"

    def profile(self) -> ProfileDescription | None:
        """The profile that a test put there."""
        return self.table_profile and cast("ProfileDescription", whole(ProfileDescription, self.table_profile))

    def guide(self, do: str, wish: RecordingWish | None = None, *, yes_move: bool = False) -> None:
        """Note it, and what was wished of the recording that begins."""
        self.asked.append(f"guide {do}")
        self.said_yes = yes_move
        if do == "begin":
            self.wish = wish

    def stop_recording(self) -> RunDocument:
        self.asked.append("stop_recording")
        self.recording = False
        return result()

    def end(self) -> EndReport | None:
        """How it ended, if a test says so."""
        return self.report

    def stop(self, by: str = "") -> EndReport:
        self.asked.append("stop")
        self.gone = "the acquisition has ended"
        return Lifecycle(self.name).report(result=result() if self.recording else None)

    def close(self) -> None:
        self.closed = True


def acquisition(*, recording: bool = False, **changes: Any) -> FakeClient:
    """An acquisition that records or not, whose snapshots have some fields otherwise."""
    client = FakeClient()
    client.recording = recording
    client.changes |= changes
    return client
