"""From packets to samples and files, and what is loaded before the first packet is on the disk."""

import contextlib
import subprocess
import sys
import time
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acquisitions import acquiring, unread, untimed
from helpers.blocks import Stamped, block_of, blocks_of
from helpers.documents import effect, effects_toml, state
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from imutui.instrument.clock import Gap, Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.jobs.info import brief, info
from imutui.jobs.replay import replay
from imutui.logbook import effects_file, reader, schemas
from imutui.logbook.effects_file import EffectsDocument
from imutui.logbook.log_time import Timebase
from imutui.logbook.reading import Reading
from imutui.logbook.samples import SampleGroups
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import engine, live_filter, recording
from imutui.session.plan import Plan, RecordingWish
from imutui.session.run import Run

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
    run = Run(info, Timebase(START), writer, None, effects_file.maker(FILE, info))
    rng = np.random.default_rng(3)
    for k in range(2000):
        counts = [int(x) for x in rng.normal(size=6) * 40 + [0, 0, 0, 0, 0, 5461]]
        if 900 < k < 910:
            counts[0] = 32767  # at the limit: no reading, but a temperature
        packet = Packet(Mode.SCALED, tuple(counts[:3]), tuple(counts[3:]), 1550 + k // 20 + int(rng.integers(3)), k)
        stamp = Stamp(k * 7_518_797, False)
        run.take(block_of(packet, stamp, stamp.monotonic_ns + 2_000_000))
    document = run.finish(2000 * 7_518_797)
    assert document["alarms"] == run.filter.estimator.alarms()  # type: ignore[union-attr]
    return document


@pytest.mark.parametrize(
    ("sampling", "rate_hz", "valid"), [("polled", 133.0, "11011"), ("stream", 133.0, "11011"), ("stream", 67.0, "10")]
)
def test_a_count_at_its_limit_is_no_reading_of_its_own_sample(
    tmp_path: Path, sampling: str, rate_hz: float, valid: str
) -> None:
    info = SessionInfo(filter="none", sampling=sampling, rate_hz=rate_hz)
    writer = LogWriter(tmp_path / "a.mcap", info, "", START)
    run = Run(info, Timebase(START), writer)
    for k in range(5):
        packet = Packet(Mode.SCALED, (32767 if k == 2 else 0, 0, 0), (0, 0, 5461), 1550, k)
        run.take(block_of(packet, Stamp(k * 7_518_797, False), k * 7_518_797))
    run.finish(5 * 7_518_797)
    assert "".join(str(int(one)) for one in reader.read(tmp_path / "a.mcap").samples.valid) == valid


def messages_of(path: Path, rate_hz: float, size: int) -> list[tuple[str, int, int, int, bytes]]:
    """All of a log whose packets came in blocks of a size, with losses and readings at the limit among them."""
    info = SessionInfo(rate_hz=rate_hz)
    writer = LogWriter(path, info, "", START)
    run = Run(info, Timebase(START), writer)
    rng, block = np.random.default_rng(3), list[Stamped]()
    for k in range(600):
        counts = [int(x) for x in rng.normal(size=6) * 40 + [0, 0, 0, 0, 0, 5461]]
        counts[1] = -32768 if k % 97 == 50 else counts[1]
        stamp = Stamp(k * 7_518_797, k % 5 == 0, k, Gap(0.015, 1, 2) if k % 41 == 7 else None)
        packet = Packet(Mode.SCALED, tuple(counts[:3]), tuple(counts[3:]), 1550 + k % 7, -k % 65536)
        block.append((packet, stamp, stamp.monotonic_ns + 2_000_000))
        if len(block) == size:
            for part in blocks_of(block):
                run.take(part)
            block = []
    for part in blocks_of(block):
        run.take(part)
    run.finish(600 * 7_518_797)
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
    acquisition = unread(plan, SessionInfo(filter="none", operator="Ada"))
    made = acquisition.recording
    with pytest.raises(ValueError, match="nothing is being recorded"):
        made.describe("warm", None)
    path = made.record(RecordingWish())
    made.describe("warm", None)
    made.describe(None, "Bo")
    acquisition.every_second()
    assert (brief(path).state, info(path)["note"]) == ("being written", "warm")
    made.end()
    told = info(path)
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

    def slow(*arguments: Any, **options: Any) -> LogWriter:
        time.sleep(0.6)
        return LogWriter(*arguments, **options)

    monkeypatch.setattr(engine, "_FIRST_PACKET_S", 0.3)
    monkeypatch.setattr(recording, "LogWriter", slow)
    with acquiring(home) as run:
        assert run.seen()["state"] == "running"


# averaging

PERIOD_NS = 7_500_000


def feed(rate_hz: float, n: int, drop: Collection[int] = (), size: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and counts of the samples of packets at 133.3 Hz, whose counts are their number, in blocks of a size."""
    groups = SampleGroups(rate_hz, each=False)
    numbers = np.array([k for k in range(n) if k not in drop])
    made = []
    for first in range(0, numbers.size, size):
        block = numbers[first : first + size]
        counts = np.column_stack([block] * 6 + [1000 + block]).astype(float)
        made.append(groups.take(block * PERIOD_NS, counts, np.ones(block.size, bool)))
    return np.concatenate([stamps for _, stamps, _, _ in made]), np.concatenate([counts for _, _, counts, _ in made])


@pytest.mark.parametrize("rate", [0.1, 1.0, 20.0, 50.0, 100.0, 120.0])
@pytest.mark.parametrize("size", [1, 67])
def test_the_rate_is_the_one_asked_and_every_packet_counts_once(rate: float, size: int) -> None:
    n = int(40e9 / PERIOD_NS)
    stamps, _ = feed(rate, n, size=size)
    assert abs(len(stamps) - 40 * rate) <= 2
    # a sample is at the mean instant of its packets, which are all that begin in its period
    begins = np.ceil(np.arange(len(stamps) + 1) * 1e9 / rate / PERIOD_NS)
    means = [np.mean(np.arange(a, b)) for a, b in pairwise(begins)] if rate < 100.0 else stamps / PERIOD_NS
    assert np.allclose(stamps / PERIOD_NS, means)


def test_a_sample_is_the_mean_of_its_packets_at_their_mean_instant() -> None:
    stamps, counts = feed(20.0, 500)
    assert np.allclose(counts[:, :6], stamps[:, None] / PERIOD_NS)
    assert np.allclose(counts[:, 6], 1000 + stamps / PERIOD_NS)


def test_a_period_without_packets_gives_no_sample() -> None:
    (whole, _), (holed, _) = feed(20.0, 200, size=7), feed(20.0, 200, drop=set(range(40, 80)), size=7)
    assert len(whole) - len(holed) == 6
    assert whole[-1] == holed[-1]


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
    run = Run(info, Timebase(START), LogWriter(path, info, "", START))
    run.take(block_of(Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0), Stamp(0, True), 2_000_000))
    assert on_disk == [1]
    assert run.filter is not None
    assert run.filter.estimator is None
