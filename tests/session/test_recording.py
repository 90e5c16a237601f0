"""From packets to samples and files, and what is loaded before the first packet is on the disk."""

import contextlib
import subprocess
import sys
import time
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acquisitions import acquiring, untimed
from helpers.documents import effect, effects_toml, state
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from imutui.instrument.clock import Gap, Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.jobs.info import brief, info
from imutui.jobs.replay import replay
from imutui.logbook import effects_file, reader, schemas
from imutui.logbook.effects_file import EffectsDocument
from imutui.logbook.reading import Reading
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import engine, live_filter, recorder
from imutui.session.lifecycle import Lifecycle
from imutui.session.plan import Plan
from imutui.session.recording import Recording, finish_file
from imutui.session.sample_pipeline import Averager, Sample, SamplePipeline, Stamped
from imutui.session.timebase import Timebase

START = 1_795_257_000_000_000_000
FILE = effects_toml(effect("thermal_lin", "gy", state("k", "rad/s/K", 1e-3, 1e-3))).encode()


class Thermal:
    """One coefficient times the temperature's departure from a slow mean of its own, on the y gyro."""

    names = ("thermal_lin gy k",)
    tau, q = np.array([np.inf]), np.zeros(1)

    def __init__(self, document: EffectsDocument) -> None:
        self.mean = np.array([state.mean for state in document.states])
        self.covariance = document.covariance()
        self._slow = np.nan

    def rows(
        self, t: np.ndarray, gyro: np.ndarray, accel: np.ndarray, temperature: np.ndarray, known: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        phi = np.zeros((t.size, 6, 1))
        for k, value in enumerate(temperature.tolist()):
            self._slow = value if np.isnan(self._slow) else self._slow + 0.05 * (value - self._slow)
            phi[k, 4, 0] = value - self._slow
        return phi, np.ones((t.size, 6)), temperature < 27.0


@pytest.fixture
def catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """One effect that can be included."""
    monkeypatch.setattr(effects_file, "build", lambda document, info: Thermal(document))


def recorded(path: Path, sampling: str) -> dict[str, Any]:
    """A recording of 15 s with effects, fed packet by packet: its result document."""
    info = SessionInfo(
        sampling=sampling, rate_hz=133.0 if sampling == "polled" else 20.0, effects_sha256=effects_file.digest(FILE)
    )
    writer = LogWriter(path, info, "", START)
    writer.attach(effects_file.ATTACHMENT, effects_file.MEDIA_TYPE, FILE, START)
    pipeline = SamplePipeline(info, Timebase(START), writer, None, effects_file.maker(FILE, info))
    rng = np.random.default_rng(3)
    for k in range(2000):
        counts = [int(x) for x in rng.normal(size=6) * 40 + [0, 0, 0, 0, 0, 5461]]
        if 900 < k < 910:
            counts[0] = 32767  # at the limit: no reading, but a temperature
        packet = Packet(Mode.SCALED, tuple(counts[:3]), tuple(counts[3:]), 1550 + k // 20 + int(rng.integers(3)), k)
        stamp = Stamp(k * 7_518_797, False)
        pipeline.packets([(packet, stamp, stamp.monotonic_ns + 2_000_000)])
    document = finish_file(writer, pipeline, 2000 * 7_518_797)
    assert document["alarms"] == pipeline.filter.estimator.alarms()  # type: ignore[union-attr]
    return document


@pytest.mark.parametrize(
    ("sampling", "rate_hz", "valid"), [("polled", 133.0, "11011"), ("stream", 133.0, "11011"), ("stream", 67.0, "10")]
)
def test_a_count_at_its_limit_is_no_reading_of_its_own_sample(
    tmp_path: Path, sampling: str, rate_hz: float, valid: str
) -> None:
    info = SessionInfo(filter="none", sampling=sampling, rate_hz=rate_hz)
    writer = LogWriter(tmp_path / "a.mcap", info, "", START)
    pipeline = SamplePipeline(info, Timebase(START), writer)
    for k in range(5):
        packet = Packet(Mode.SCALED, (32767 if k == 2 else 0, 0, 0), (0, 0, 5461), 1550, k)
        pipeline.packets([(packet, Stamp(k * 7_518_797, False), k * 7_518_797)])
    finish_file(writer, pipeline, 5 * 7_518_797)
    assert "".join(str(int(one)) for one in reader.read(tmp_path / "a.mcap").samples.valid) == valid


def messages_of(path: Path, rate_hz: float, size: int) -> list[tuple[str, int, int, int, bytes]]:
    """All of a log whose packets came in blocks of a size, with losses and readings at the limit among them."""
    info = SessionInfo(rate_hz=rate_hz)
    writer = LogWriter(path, info, "", START)
    pipeline = SamplePipeline(info, Timebase(START), writer)
    rng, block = np.random.default_rng(3), list[Stamped]()
    for k in range(600):
        counts = [int(x) for x in rng.normal(size=6) * 40 + [0, 0, 0, 0, 0, 5461]]
        counts[1] = -32768 if k % 97 == 50 else counts[1]
        stamp = Stamp(k * 7_518_797, k % 5 == 0, k, Gap(0.015, 1, 2) if k % 41 == 7 else None)
        packet = Packet(Mode.SCALED, tuple(counts[:3]), tuple(counts[3:]), 1550 + k % 7, -k % 65536)
        block.append((packet, stamp, stamp.monotonic_ns + 2_000_000))
        if len(block) == size:
            pipeline.packets(block)
            block = []
    if block:
        pipeline.packets(block)
    finish_file(writer, pipeline, 600 * 7_518_797)
    with path.open("rb") as stream:
        found = NonSeekingReader(stream).iter_messages(log_time_order=False)
        messages = [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in found]
    # how long ago the disk took all is by the clock of now
    return [message for message in messages if message[0] != schemas.DIAGNOSTICS]


@pytest.mark.parametrize("rate_hz", [133.0, 20.0])
def test_blocks_of_any_size_make_the_same_file(tmp_path: Path, rate_hz: float) -> None:
    live_filter.PLAIN.begin()
    assert live_filter.PLAIN.ready.wait(120.0)
    one = messages_of(tmp_path / "1.mcap", rate_hz, 1)
    assert {topic for topic, *_ in one} >= {schemas.RAW, schemas.IMU, schemas.TEMPERATURE, schemas.ESTIMATE}
    for size in (2, 7, 67, 600):
        assert messages_of(tmp_path / f"{size}.mcap", rate_hz, size) == one


@pytest.mark.usefixtures("catalogue")
@pytest.mark.parametrize("sampling", ["stream", "polled"])
def test_live_and_replayed_results_are_equal_with_effects(tmp_path: Path, sampling: str) -> None:
    live_filter.PLAIN.begin()
    live = recorded(tmp_path / "a.mcap", sampling)
    again = replay(tmp_path / "a.mcap", Reading())
    assert untimed(again) == untimed(live)
    (state,) = live["effects"]
    assert state["name"] == "thermal_lin gy k"
    assert 0.0 < state["sd"] < 1e-3
    without = replay(tmp_path / "a.mcap", Reading(effects=effects_file.NONE))
    assert without["effects"] == []
    assert without["config_sha256"] != live["config_sha256"]
    assert without["final"]["gyro_bias_dps"] != live["final"]["gyro_bias_dps"]
    # another file's effects go before the log's own
    other = replay(tmp_path / "a.mcap", Reading(effects=FILE.replace(b"sd = 0.001", b"sd = 1e-6")))
    assert other["effects"][0]["sd"] <= 1e-6


def test_note_and_operator_of_a_file_that_is_written_can_be_changed(tmp_path: Path) -> None:
    plan = Plan("none", filter="none", logs=str(tmp_path), operator="Ada", min_free_mb=0.0)
    made = recorder.Recorder(plan, SessionInfo(filter="none", operator="Ada"), Lifecycle(), Timebase(START))
    with pytest.raises(ValueError, match="nothing is being recorded"):
        made.describe("warm", None)
    made.begin("", tmp_path / "a.mcap")
    made.describe("warm", None)
    made.describe(None, "Bo")
    made.pipeline.flush(time.monotonic_ns())
    assert (brief(tmp_path / "a.mcap").state, info(tmp_path / "a.mcap")["note"]) == ("being written", "warm")
    made.end_recording()
    told = info(tmp_path / "a.mcap")
    assert (told["note"], told["operator"], made.plan.operator, made.plan.note) == ("warm", "Bo", "Bo", "")
    assert [e["text"] for e in told["events"]][1:] == ["note: warm (before: none)", "operator: Bo (before: Ada)"]


@pytest.mark.usefixtures("catalogue")
def test_effects_and_a_filter_that_takes_none_are_refused(tmp_path: Path) -> None:
    recorded(tmp_path / "a.mcap", "stream")
    with pytest.raises(ValueError, match='"ekf", but effects'):
        replay(tmp_path / "a.mcap", Reading(overrides={"filter": "ekf"}))
    assert replay(tmp_path / "a.mcap", Reading(end=2.0, overrides={"filter": "ekf"}, effects=effects_file.NONE))[
        "samples"
    ]


def test_a_log_whose_effects_are_not_known_says_so(tmp_path: Path) -> None:
    info = replace(SessionInfo(), effects_sha256=effects_file.digest(FILE))
    writer = LogWriter(tmp_path / "a.mcap", info, "", START)
    writer.attach(effects_file.ATTACHMENT, effects_file.MEDIA_TYPE, FILE.replace(b"thermal_lin", b"gremlins"), START)
    writer.imu(START, START, np.zeros(3), np.array([0.0, 0.0, -9.8]))
    writer.finish({}, START)
    with pytest.raises(ValueError, match=r"a\.mcap: .*gremlins.*--effects none"):
        replay(tmp_path / "a.mcap", Reading())


def test_a_busy_machine_may_take_its_time_for_the_first_packet(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What has been read by the deadline was sent: the unit is not called silent because its file is not begun yet."""

    def slow(*arguments: Any) -> Recording:
        time.sleep(0.6)
        return Recording(*arguments)

    monkeypatch.setattr(engine, "_FIRST_PACKET_S", 0.3)
    monkeypatch.setattr(recorder, "Recording", slow)
    with acquiring(home) as run:
        assert run.seen()["state"] == "running"


# averaging

PERIOD_NS = 7_500_000


def feed(averager: Averager, n: int, drop: Collection[int] = ()) -> list[Sample]:
    """Packets at 133.3 Hz whose counts are their number."""
    out = []
    for k in range(n):
        if k not in drop:
            sample = averager.add(k * PERIOD_NS, (k, k, k, k, k, k, 1000 + k))
            if sample is not None:
                out.append(sample)
    return out


@pytest.mark.parametrize("rate", [0.1, 1.0, 20.0, 50.0, 100.0, 120.0])
def test_the_rate_is_the_one_asked_and_every_packet_counts_once(rate: float) -> None:
    n = int(40e9 / PERIOD_NS)
    samples = feed(Averager(rate), n)
    assert abs(len(samples) - 40 * rate) <= 2
    assert n - sum(s.packets for s in samples) <= 134 / rate


def test_a_sample_is_the_mean_of_its_packets_at_their_mean_instant() -> None:
    for sample in feed(Averager(20.0), 500):
        assert np.allclose(sample.counts, sample.stamp_ns / PERIOD_NS)
        assert sample.temperature == pytest.approx(1000 + sample.stamp_ns / PERIOD_NS)


def test_a_period_without_packets_gives_no_sample() -> None:
    whole, holed = feed(Averager(20.0), 200), feed(Averager(20.0), 200, drop=set(range(40, 80)))
    assert len(whole) - len(holed) == 6
    assert whole[-1].stamp_ns == holed[-1].stamp_ns


# What is loaded before the first packet is on the disk, and what is not

HEAVY = ("numba", "scipy.signal", "scipy.stats")


@pytest.mark.parametrize(
    "program", ["imutui.session.__main__", "imutui.cli.follow_acquisition", "imutui.cli.virtual_readings"]
)
def test_neither_compiler_nor_statistics_are_loaded_to_begin_with(program: str) -> None:
    code = f"import sys, {program}; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


def packets_in(path: Path) -> int:
    """Raw packets in a log that is still being written."""
    with path.open("rb") as stream, contextlib.suppress(EndOfFile):
        count = 0
        for _, channel, _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
            count += channel.topic == schemas.RAW
    return count


def test_the_first_packet_is_on_the_disk_before_the_filter_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Loading it takes a second or more, compiling it many; a power cut meanwhile costs nothing but what came since."""
    path = tmp_path / "a.mcap"
    on_disk: list[int] = []
    unprepared = live_filter.Preparation(effects=False)
    monkeypatch.setattr(unprepared, "begin", lambda: on_disk.append(packets_in(path)))
    monkeypatch.setattr(live_filter, "PLAIN", unprepared)
    info = SessionInfo(sampling="polled", rate_hz=20.0)
    pipeline = SamplePipeline(info, Timebase(START), LogWriter(path, info, "", START))
    pipeline.packets([(Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0), Stamp(0, True), 2_000_000)])
    assert on_disk == [1]
    assert pipeline.filter is not None
    assert pipeline.filter.estimator is None
