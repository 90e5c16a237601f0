"""Rebuilding logs, by the job that people call: whole files in, damaged ones in, nothing lost that was whole."""

import contextlib
import random
import struct
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ros_messages
from helpers.logs import START, chunks, recorded
from helpers.mutations import spoilt_log
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

from imutui.jobs.recover import recover
from imutui.jobs.replay import replay
from imutui.logbook import SessionInfo, added_notes, file_lock, pieces, reader, schemas, summary
from imutui.logbook import recover as rebuilding
from imutui.logbook.reader import UnreadableLogError
from imutui.logbook.reading import Reading
from imutui.logbook.recover import NotAsWrittenError
from imutui.logbook.results import TIMINGS
from imutui.logbook.scan import RECOVERED
from imutui.logbook.writer import LogWriter

DETAILS = ((-7, 8, 9), 10, 0x0002)


def written(
    path: Path, seconds: int = 4, rate: int = 5, *, finish: bool = True, details: ros_messages.Details | None = None
) -> bytes:
    """A small log with a chunk a second and an attachment, in words of bytes."""
    info = SessionInfo(serial_number="42", rate_hz=rate, kind="simulated")
    raw_type = schemas.raw_type(details=details is not None)
    log = LogWriter(path, info, "x = 1\n", START, raw_type=raw_type)
    log.attach("effects.toml", "application/toml", b"version = 1\n", START)
    rng = np.random.default_rng(5)
    for k in range(seconds * rate):
        stamp = START + k * 1_000_000_000 // rate
        log.encoded(
            schemas.RAW, ros_messages.packet(k, k, (1, 2, 3, 4, 5, 6), 1587, 65535 - k, details=details), stamp, stamp
        )
        log.imu(stamp, stamp, rng.normal(size=3), rng.normal(size=3))
        if k % rate == rate - 1:
            log.encoded(schemas.EVENTS, schemas.encode_event(stamp, "mark", f"mark {k}"), stamp, stamp)
            log.flush()
    if finish:
        log.finish({"samples": seconds * rate}, START)
    else:
        log.flush_file()
    return path.read_bytes()


def messages(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    """All messages in file order, by mcap's own reader: topic, number, times, bytes."""
    out = []
    with path.open("rb") as stream, contextlib.suppress(EndOfFile, struct.error):
        for _, channel, m in NonSeekingReader(stream).iter_messages(log_time_order=False):
            out.append((channel.topic, m.sequence, m.log_time, m.publish_time, m.data))
    return out


def made(source: Path, data: bytes) -> Path:
    source.write_bytes(data)
    return source


def recovered(source: Path) -> tuple[dict[str, Any], Path]:
    output = source.with_name("out.mcap")
    document = recover(source, output, True)
    assert not list(source.parent.glob("*.part"))
    return document, output


@pytest.mark.parametrize("finish", [True, False])
def test_a_log_recovers_to_the_same_messages(tmp_path: Path, *, finish: bool) -> None:
    written(tmp_path / "a.mcap", finish=finish)
    before = (tmp_path / "a.mcap").read_bytes()
    document, output = recovered(tmp_path / "a.mcap")
    assert messages(output) == messages(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == before
    log, source = reader.read(output), reader.read(tmp_path / "a.mcap")
    assert log.finished
    assert log.damage == ""
    assert log.info == source.info
    assert log.attachments == source.attachments
    assert document["complete"]
    assert (document["samples"], document["messages"]) == (20, 45)
    assert document["lost"] == {"messages": 0, "samples": 0}
    assert summary.read(output).state == "finished"
    with AnyReader([output]) as bag:
        assert sum(1 for _ in bag.messages()) == 45


def test_a_rebuilt_log_says_so_and_from_what(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap")
    at, length = chunks(data)[1]
    made(tmp_path / "a.mcap", data[: at + 60] + bytes([data[at + 60] ^ 1]) + data[at + 61 :])
    _, output = recovered(tmp_path / "a.mcap")
    with output.open("rb") as stream:
        notes = {m.name: m.metadata for m in NonSeekingReader(stream).iter_metadata()}
    assert notes[RECOVERED]["source"] == "a.mcap"
    assert f"{length} bytes at byte {at:,}" in notes[RECOVERED]["lost"]
    assert "imutui.session" in notes


def test_what_was_added_to_a_log_goes_along_with_the_rebuilt_one(tmp_path: Path) -> None:
    log, out = tmp_path / "a.mcap", tmp_path / "b.mcap"
    written(log)
    added_notes.add(log, "second cold start", "ana")
    recover(log, out)
    assert [(each.note, each.operator) for each in added_notes.read(out)] == [("second cold start", "ana")]
    added_notes.path_of(log).unlink()
    recover(log, out, overwrite=True)
    assert added_notes.read(out) == ()


def test_no_cut_loses_a_whole_record_or_makes_one_up(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap")
    whole = messages(tmp_path / "a.mcap")
    # packets, samples and a mark each second; before the first sample its transform
    ends = {0: 0} | {at + length: 1 + 11 * (k + 1) for k, (at, length) in enumerate(chunks(data))}
    last = chunks(data)[-1]
    cuts = {*range(len(data) - 60, len(data)), *range(last[0] - 20, last[0] + 60), *range(9)}
    cuts |= set(random.Random(7).sample(range(len(data)), 60))
    for size in sorted(cuts):
        cut = made(tmp_path / "cut.mcap", data[:size])
        expected = max(n for end, n in ends.items() if end <= size)
        if expected == 0:
            with pytest.raises(UnreadableLogError, match=r"cut\.mcap"):
                recover(cut, tmp_path / "out.mcap", True)
            continue
        document, output = recovered(cut)
        assert messages(output) == whole[:expected], size
        assert document["complete"], document["sentences"]
        assert reader.read(output).finished


def test_a_flipped_byte_costs_its_chunk_and_nothing_else(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap")
    whole = messages(tmp_path / "a.mcap")
    rng = random.Random(3)
    first = {at + k for at, _ in chunks(data) for k in (0, 1, 3, 8, 20, 40, 45, 50)}
    for at in sorted({*rng.sample(range(len(data)), 80), *first}):
        flipped = made(tmp_path / "f.mcap", data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :])
        document, output = recovered(flipped)
        kept = messages(output)
        assert len(kept) == len(set(kept))
        assert set(kept) <= set(whole), at
        assert len(kept) >= len(whole) - 12, (at, document["sentences"])
        assert kept == [m for m in whole if m in set(kept)]
        assert document["lost"]["messages"] == len(whole) - len(kept)
        assert document["complete"] or document["sentences"]
        # a byte of the session's metadata may be what makes it unusable; that is told
        assert not document["readable"] or reader.read(output).finished


@pytest.mark.parametrize("details", [None, DETAILS], ids=["RawPacket", "S1Packet"])
def test_a_lost_first_chunk_takes_no_other_with_it(tmp_path: Path, details: ros_messages.Details | None) -> None:
    """The list of topics is in the first chunk: it comes from the summary, else from what imutui always writes."""
    data = written(tmp_path / "a.mcap", details=details)
    (at, _), (second, _), *_ = chunks(data)
    broken = data[: at + 100] + bytes(50) + data[at + 150 :]
    for end in (None, -600):
        document, output = recovered(made(tmp_path / "b.mcap", broken[:end]))
        log = reader.read(output, raw=True)
        assert log.samples.stamp_ns.size == 15
        assert [event.text for event in log.events] == ["mark 9", "mark 14", "mark 19"]
        assert document["lost"]["samples"] == 5
        found = [(tuple(p.rate_temperatures), p.board_temperature, p.status) for p in ros_messages.packets(log)]
        assert found == [details or ((0, 0, 0), 0, 0)] * 15
    assert any("list of topics" in sentence for sentence in document["sentences"])
    assert second > at


def test_garbage_behind_the_end_is_left_out_and_told(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap")
    garbage = random.Random(1).randbytes(5000)
    document, output = recovered(made(tmp_path / "a.mcap", data + garbage))
    assert document["messages"] == 45
    assert any("5,000 bytes behind the end" in sentence for sentence in document["sentences"])
    assert summary.read(output).state == "finished"


def test_a_hole_in_the_middle_is_skipped(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap", finish=False)
    (_, _), (at, length), (after, _), *_ = chunks(data)
    for broken in (data[: at + 5] + bytes(length) + data[at + 5 + length :], data[: at + 5] + data[at + 400 :]):
        document, output = recovered(made(tmp_path / "b.mcap", broken))
        events = [event.text for event in reader.read(output).events]
        assert "mark 4" in events
        assert "mark 19" in events
        assert "mark 9" not in events
        assert document["lost"]["samples"] in (5, 10)
        assert not document["complete"]
    assert after > at


def test_a_chunk_that_stands_twice_is_taken_once(tmp_path: Path) -> None:
    data = written(tmp_path / "a.mcap", finish=False)
    _, (at, length), *_ = chunks(data)
    document, output = recovered(made(tmp_path / "b.mcap", data[: at + length] + data[at:]))
    assert messages(output) == messages(tmp_path / "a.mcap")
    assert any("twice" in sentence for sentence in document["sentences"])


def test_the_replay_of_a_recovered_log_equals_that_of_the_unfinished_one(tmp_path: Path) -> None:
    written(tmp_path / "a.mcap", seconds=8, rate=10, finish=False)
    _, output = recovered(tmp_path / "a.mcap")
    before, after = (replay(path, Reading()) for path in (tmp_path / "a.mcap", output))
    assert not before["finished"]
    assert after["finished"]
    ignored = {*TIMINGS, "log", "log_sha256", "finished", "damage"}
    assert {k: v for k, v in before.items() if k not in ignored} == {k: v for k, v in after.items() if k not in ignored}


def test_another_programs_file_is_rebuilt_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(profile="", library="somebody")
        writer.register_schema("unused", "jsonschema", b"{}")
        schema = writer.register_schema("thing", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/thing", "json", schema, {"key": "value"})
        for k in range(10):
            writer.add_message(channel, START + k, b'{"k": %d}' % k, START + k, sequence=3 * k)
        writer.finish()
    data = path.read_bytes()
    end = data.index(b'{"k": 9}') + 8
    document, output = recovered(made(path, data[:end]))
    assert messages(output) == messages(path)
    assert len(messages(output)) == 10
    assert document["lost"]["messages"] is None
    with output.open("rb") as stream:
        (thing,) = {c.topic: c for _, c, _ in NonSeekingReader(stream).iter_messages()}.values()
    assert thing.metadata == {"key": "value"}


def test_what_is_no_log_or_is_in_use_is_refused_in_words(tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    for name, content, said in (
        ("none", None, "no such file"),
        ("empty", b"", "empty"),
        ("text", b"hello", "not an MCAP"),
    ):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(UnreadableLogError, match=said):
            recover(tmp_path / name, out)
    written(tmp_path / "a.mcap")
    (tmp_path / "link.mcap").symlink_to(tmp_path / "a.mcap")
    before = (tmp_path / "a.mcap").read_bytes()
    with pytest.raises(ValueError, match="log itself"):
        recover(tmp_path / "a.mcap", tmp_path / "link.mcap", True)
    out.write_text("mine")
    with pytest.raises(FileExistsError):
        recover(tmp_path / "a.mcap", out)
    assert out.read_text() == "mine"
    with (tmp_path / "a.mcap").open("r+b") as stream:
        file_lock.claim(stream)
        with pytest.raises(ValueError, match="being written"):
            recover(tmp_path / "a.mcap", out, True)
    assert (tmp_path / "a.mcap").read_bytes() == before


def test_pieces_of_any_size_make_the_same_file_and_say_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "gmtime", lambda: time.struct_time((2026, 1, 1, 0, 0, 0, 3, 1, 0)))
    whole, rng = pieces.ROWS, random.Random(11)
    path, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    readable = 0
    for content in (written(tmp_path / "b.mcap"), recorded(tmp_path / "c.mcap").read_bytes()):
        for k in range(12):
            first, second = sorted(rng.randrange(len(content)) for _ in range(2))
            kinds = spoilt_log(rng, content), content[:second], content[:first] + content[second:], content[:second]
            made(path, kinds[k % 3] if k % 4 else kinds[3] + content[first:])
            said = []
            for rows in (whole, 7, 1):
                monkeypatch.setattr(pieces, "ROWS", rows)
                out.unlink(missing_ok=True)
                try:
                    said.append((recover(path, out), out.read_bytes()))
                    readable += said[-1][0]["readable"]
                except UnreadableLogError as error:
                    said.append((str(error), b""))
            assert said[1] == said[2] == said[0]
    assert readable > 40


def test_a_rebuilt_file_that_lacks_what_the_source_has_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, other = written(tmp_path / "a.mcap"), written(tmp_path / "b.mcap", seconds=3)
    (tmp_path / "b.mcap").unlink()
    read_back = rebuilding._read_back

    def of_a_failing_disk(part: Path, kept: Any) -> None:
        part.write_bytes(other)
        read_back(part, kept)

    monkeypatch.setattr(rebuilding, "_read_back", of_a_failing_disk)
    with pytest.raises(NotAsWrittenError, match="did not read back"):
        recover(tmp_path / "a.mcap", tmp_path / "out.mcap")
    assert not list(tmp_path.glob("out*"))
    assert (tmp_path / "a.mcap").read_bytes() == data


def test_four_times_the_log_takes_no_more_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "ROWS", 200)
    most = []
    for count in (2000, 8000):
        path = tmp_path / f"{count}.mcap"
        log = LogWriter(path, SessionInfo(rate_hz=100, kind="simulated"), "", START)
        for k, row in enumerate(np.random.default_rng(1).normal(size=(count, 6))):
            log.imu(START + k * 10_000_000, START + k * 10_000_000, row[:3], row[3:])
            if k % 50 == 49:
                log.flush()
        log.finish({}, START)
        tracemalloc.start()
        try:
            document = recover(path, tmp_path / "out.mcap", True)
            most.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert document["samples"] == count
    assert most[1] - most[0] < 0.5 * 6000 * 7 * 8
