import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.blocks import block_of
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import Message
from mcap.writer import CompressionType, Writer

from imutui.instrument.clock import Gap, Stamp
from imutui.instrument.driver import Driver
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.instrument.imu400.driver import Imu400cd
from imutui.instrument.registry import INSTRUMENTS
from imutui.instrument.uut.messages import PacketS1
from imutui.jobs.check import check as check_once
from imutui.jobs.info import info
from imutui.logbook import audit, schemas
from imutui.logbook.log_time import Timebase
from imutui.logbook.mcap_format import records
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session.run import Run
from imutui.session.stream import Said

START = 1_795_257_000_000_000_000
LOOP_NS = {"imu400cd": 7_500_000, "imu381": 10_000_000}
SECONDS = 6

Change = Callable[[str, int, Message], list[Message]]


def check(path: Path) -> dict[str, Any]:
    """What is said of a log; whether it is looked at in one part or a chunk at a time must not be seen."""
    whole = check_once(path), info(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(audit, "MESSAGES", 1)
        assert json.dumps((check_once(path), info(path))) == json.dumps(whole)
    return dict(whole[0])


def recorded(
    path: Path,
    *,
    sampling: str = "stream",
    rate: float = 20.0,
    lost: int = 0,
    limit: int | None = None,
    port: str = "",
    held_up: bool = False,
    instrument: type[Driver] = Imu400cd,
) -> Path:
    """A recording as the acquisition writes it: a packet a loop, every second flushed, some lost on the line."""
    info = SessionInfo(serial_number="42", kind="simulated", sampling=sampling, rate_hz=rate, filter="none", port=port)
    ranges = instrument.rate_range_dps, instrument.accel_range_g
    info = replace(info, instrument=instrument.model, rate_range_dps=ranges[0], accel_range_g=ranges[1])
    writer = LogWriter(
        path, info, "x = 1\n", START, raw_type=schemas.raw_type(details=instrument.status_names is not None)
    )
    run = Run(info, Timebase(START), writer, instrument=instrument)
    rng = np.random.default_rng(8)
    loop_ns = LOOP_NS[instrument.name]
    dropped, second = 0, 1
    for k in range(round(SECONDS * 1e9 / loop_ns)):
        if 300 <= k < 300 + lost:
            dropped += 1
            continue
        counts = [int(x) for x in rng.normal(size=6) * 40 + [0, 0, 0, 0, 0, 5461]]
        if limit is not None and k == 200:
            counts[limit] = 32767
        packet = packet_of(instrument, counts, k)
        instant = k * loop_ns
        # what comes while the computer is held up is read at once when it goes on
        read = 299 * loop_ns if held_up and 100 <= k < 300 else instant
        stamp = Stamp(instant, False, gap=Gap(0.0, dropped, dropped) if dropped else None)
        run.take(block_of(packet, stamp, read + 2_000_000))
        dropped = 0
        if instant >= second * 1_000_000_000:
            run.flush(instant + 2_000_000)
            second += 1
    run.take(Said("mark", "here", at_ns=SECONDS * 1_000_000_000))
    assert run.finish(SECONDS * 1_000_000_000)["finished"]
    return path


def packet_of(instrument: type[Driver], counts: list[int], k: int) -> Any:
    """A packet at the loop's instant k, below freezing where the unit's counts say so."""
    ticks = round(instrument.counter.direction * k * LOOP_NS[instrument.name] / instrument.counter.tick_ns) % 65536
    rates, accels = tuple(counts[:3]), tuple(counts[3:])
    if instrument is Imu400cd:
        return Packet(Mode.SCALED, rates, accels, 1550, ticks)
    return PacketS1(accels, rates, (-700, -701, -702), -690, ticks, 2)


def rewritten(path: Path, change: Change) -> Path:
    """The same log with its messages changed: topic, number within it, message → what stands in its place."""
    with path.open("rb") as stream:
        metadata = list(NonSeekingReader(stream).iter_metadata())
        stream.seek(0)
        attachments = list(NonSeekingReader(stream).iter_attachments())
        stream.seek(0)
        messages = list(NonSeekingReader(stream).iter_messages(log_time_order=False))
    out = path.with_name("changed.mcap")
    seen: dict[str, int] = {}
    with out.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, chunk_size=20_000)
        writer.start("ros2", "test")
        for m in metadata:
            writer.add_metadata(m.name, m.metadata)
        for a in attachments:
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        channels: dict[str, int] = {}
        for schema, channel, message in messages:
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            k = seen[channel.topic] = seen.get(channel.topic, -1) + 1
            for m in change(channel.topic, k, message):
                writer.add_message(channels[channel.topic], m.log_time, m.data, m.publish_time, m.sequence)
        writer.finish()
    return out


def codes(document: dict[str, Any]) -> list[str]:
    return [finding["code"] for finding in document["findings"]]


@pytest.mark.parametrize(("sampling", "rate"), [("stream", 20.0), ("stream", 133.0), ("polled", 400.0 / 3.0)])
def test_a_take_as_it_is_recorded_is_fine(tmp_path: Path, sampling: str, rate: float) -> None:
    path = recorded(tmp_path / "a.mcap", sampling=sampling, rate=rate)
    document = check(path)
    assert document["findings"] == []
    assert document["fine"]
    assert document["state"] == "finished"
    assert document["packets"] == 800
    assert document["samples"] == (119 if rate == 20.0 else 800)


def test_lost_packets_are_counted_by_their_times_and_against_the_recorder(tmp_path: Path) -> None:
    document = check(recorded(tmp_path / "a.mcap", rate=133.0, lost=5))
    assert codes(document) == ["gaps", "lost"]
    assert document["findings"][1]["what"] == "5 packets were lost on the line."
    assert document["findings"][1]["where"] == "in 1 place, first at 2.243 s"
    assert document["findings"][1]["next"]


def test_one_packet_was_lost_and_two_were(tmp_path: Path) -> None:
    for lost, said in ((1, "1 packet was lost on the line."), (2, "2 packets were lost on the line.")):
        document = check(recorded(tmp_path / f"{lost}.mcap", rate=133.0, lost=lost))
        assert said in [finding["what"] for finding in document["findings"]]


def test_counts_at_their_limit_are_named_by_channel(tmp_path: Path) -> None:
    document = check(recorded(tmp_path / "a.mcap", rate=133.0, limit=1))
    assert codes(document) == ["limits"]
    assert "(gy)" in document["findings"][0]["what"]
    assert "1.500 s" in document["findings"][0]["where"]


def without(topic: str, numbers: range) -> Change:
    return lambda t, k, m: [] if t == topic and k in numbers else [m]


def with_data(topic: str, number: int, edit: Callable[[bytearray], None]) -> Change:
    def change(t: str, k: int, m: Message) -> list[Message]:
        if t == topic and k == number:
            data = bytearray(m.data)
            edit(data)
            m.data = bytes(data)
        return [m]

    return change


def shifted(topic: str, numbers: range, ns: int) -> Change:
    def change(t: str, k: int, m: Message) -> list[Message]:
        if t == topic and k in numbers:
            m.log_time += ns
        return [m]

    return change


def set_ticks(data: bytearray) -> None:
    data[34:36] = (int.from_bytes(data[34:36], "little") ^ 0x4000).to_bytes(2, "little")


def cases() -> Iterator[tuple[str, Change, str]]:
    """What is done to a log, and the finding that must come of it."""
    yield "messages missing", without(schemas.IMU, range(30, 33)), "sequence"
    yield "samples missing", without(schemas.IMU, range(30, 33)), "samples"
    yield "doubled", lambda t, k, m: [m, m] if t == schemas.IMU and k == 30 else [m], "sequence"
    yield "time stands", lambda t, k, m: [m, m] if t == schemas.IMU and k == 30 else [m], "stamps"
    yield "undecodable", with_data(schemas.EVENTS, 0, lambda d: d.__delitem__(slice(9, None))), "undecodable"
    yield "undecodable sample", with_data(schemas.IMU, 30, lambda d: d.__delitem__(slice(40, None))), "undecodable"
    yield "backwards", shifted(schemas.RAW, range(300, 301), -1_000_000_000), "log_time"
    yield "jump", shifted(schemas.RAW, range(300, 10_000), 3_600_000_000_000), "log_time"
    yield "other clock", shifted(schemas.IMU, range(10_000), -START), "log_time"
    yield "changed packet", with_data(schemas.RAW, 300, lambda d: d.__setitem__(20, d[20] ^ 0x40)), "samples"
    yield "counter jumps", with_data(schemas.RAW, 300, set_ticks), "counter"
    yield "number", with_data(schemas.RAW, 300, lambda d: d.__setitem__(4, d[4] ^ 0x01)), "packets"
    yield (
        "temperature in a packet",
        with_data(schemas.RAW, 300, lambda d: d.__setitem__(32, d[32] ^ 0x01)),
        "temperatures",
    )
    yield "temperature", with_data(schemas.TEMPERATURE, 30, lambda d: d.__setitem__(-13, d[-13] ^ 0x20)), "temperatures"
    yield "no reference", without(schemas.REFERENCE, range(1000)), "reference"


INSTRUMENT = pytest.mark.parametrize("instrument", INSTRUMENTS.values(), ids=list(INSTRUMENTS))


@INSTRUMENT
@pytest.mark.parametrize(("change", "code"), [c[1:] for c in cases()], ids=[c[0] for c in cases()])
def test_each_thing_that_is_wrong_is_found(tmp_path: Path, change: Change, code: str, instrument: type[Driver]) -> None:
    rate = instrument.most_rate_hz
    path = recorded(tmp_path / "a.mcap", rate=rate, instrument=instrument)
    assert check_once(path)["fine"]
    document = check(rewritten(path, change))
    assert code in codes(document)
    assert not document["fine"]
    for finding in document["findings"]:
        assert finding["what"].endswith(".")
        assert finding["next"].endswith(".")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda stamps, accel, degc: np.copyto(accel[3], 2e5), "sample 3 (first is 0) is beyond anything"),
        (lambda stamps, accel, degc: stamps.__setitem__(slice(4, None), stamps[4:] - 10**7 + 500), "sample 4"),
        (lambda stamps, accel, degc: degc.__setitem__(2, -1e6), "temperature of sample 2 (first is 0)"),
    ],
    ids=["reading", "step", "temperature"],
)
def test_samples_that_no_unit_sends_are_found(tmp_path: Path, spoil: Callable[..., None], words: str) -> None:
    stamps, accel = START + 10**7 * np.arange(60), np.random.default_rng(2).normal(size=(60, 3))
    degc = np.full(60, 25.0)
    for number, change in enumerate((lambda *columns: None, spoil)):
        change(stamps, accel, degc)
        log = LogWriter(tmp_path / f"{number}.mcap", SessionInfo(sampling="foreign", rate_hz=100.0), "", START)
        for stamp, own, temperature in zip(stamps.tolist(), accel, degc.tolist(), strict=True):
            log.imu(stamp, stamp, own[::-1] * 1e-3, own)
            log.encoded(schemas.TEMPERATURE, schemas.encode_temperatures(stamp, temperature)[0], stamp, stamp)
        log.finish({}, START)
        document = check(tmp_path / f"{number}.mcap")
        found = [f["what"] for f in document["findings"] if f["code"] == "samples"]
        assert [words in what for what in found] == [True] * number, document
    assert not document["fine"]


def test_rewriting_alone_is_no_finding(tmp_path: Path) -> None:
    """The cases above find what was changed, not that something was."""
    assert check(rewritten(recorded(tmp_path / "a.mcap", rate=133.0), lambda t, k, m: [m]))["findings"] == []


def test_damage_is_found_in_every_place_and_the_rest_is_looked_at(tmp_path: Path) -> None:
    data = bytearray(recorded(tmp_path / "a.mcap").read_bytes())
    places = [at for at in range(len(data)) if data.startswith(b"\x04\0\0\0zstd", at)]
    for place in (places[2], places[4]):
        data[place + 200] ^= 1
    (tmp_path / "a.mcap").write_bytes(data)
    document = check(tmp_path / "a.mcap")
    assert codes(document)[:2] == ["damage", "damage"]
    assert "of the log" in document["findings"][0]["where"]
    assert "imutui recover" in document["findings"][0]["next"]
    assert 70 < document["samples"] < 90
    assert document["state"] == "damaged"


@pytest.mark.parametrize(
    ("place", "code"),
    [(-8, "damage"), (-5, "damage"), (0, "index"), (2, "index"), (6, "index"), (14, "index")],
    ids=["length", "more than the file", "channel", "size", "time", "offset"],
)
def test_damage_in_the_index_behind_a_chunk_is_found(tmp_path: Path, place: int, code: str) -> None:
    """Where its length is wrong, too, though nothing tells what stood between it and the next record."""
    data = bytearray(recorded(tmp_path / "a.mcap").read_bytes())
    first = next(at for opcode, at, _ in records(bytes(data[8:])) if opcode == Opcode.MESSAGE_INDEX) + 8
    data[first + place] ^= 0x41
    (tmp_path / "b.mcap").write_bytes(data)
    document = check(tmp_path / "b.mcap")
    assert codes(document) == [code]
    assert document["samples"] == 119
    assert "at byte" in document["findings"][0]["where"]
    assert "imutui recover" in document["findings"][0]["next"]
    assert document["state"] == ("finished" if code == "index" else "damaged")


def test_an_unfinished_log_is_one_finding(tmp_path: Path) -> None:
    data = recorded(tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: data.index(b"summary.json") - 29])
    document = check(tmp_path / "cut.mcap")
    assert codes(document) == ["unfinished"]
    assert document["state"] == "unfinished"


def test_a_log_without_its_session_or_attachments_says_so(tmp_path: Path) -> None:
    info = SessionInfo(kind="simulated", filter="none", effects_sha256="0" * 64)
    writer = LogWriter(tmp_path / "a.mcap", info, "", START)
    for k in range(40):
        writer.imu(START + k * 50_000_000, START + k * 50_000_000, np.zeros(3), np.zeros(3))
    writer.finish({}, START)
    assert "attachment" in codes(check(tmp_path / "a.mcap"))


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("no log")
    with pytest.raises(UnreadableLogError, match="not an MCAP log"):
        check(tmp_path / "a.mcap")
    with pytest.raises(UnreadableLogError, match="no such file"):
        check(tmp_path / "b.mcap")


def test_losses_name_the_cable_only_where_there_is_one(tmp_path: Path) -> None:
    def advice(log: Path) -> str:
        return str(next(f["next"] for f in check(log)["findings"] if f["code"] == "lost"))

    assert advice(recorded(tmp_path / "a.mcap", rate=133.0, lost=5)).startswith("Check the cable")
    on_pty = advice(recorded(tmp_path / "b.mcap", rate=133.0, lost=5, port="/dev/pts/3"))
    assert "pseudo-terminal" in on_pty
    assert "heck the cable" not in on_pty
    late = recorded(tmp_path / "c.mcap", rate=133.0, lost=5, port="/dev/pts/3", held_up=True)
    assert "too busy" in advice(late)
