"""The reader over a pseudo-terminal: blocks of stamped packets, and a unit that zeroes its rate sensors."""

import queue
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from helpers.units import Still, served

from imutui.instrument.clock import Clock
from imutui.instrument.imu400 import driver
from imutui.instrument.imu400.driver import COUNTER, Imu400cd
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import Port
from imutui.session.reader_thread import LineLost, Reader, ReaderEvent, ZeroingFinished
from imutui.session.stream import Block, Broke, Stamper


@contextmanager
def reading(options: UnitOptions, poll_hz: float | None) -> Iterator[tuple[Reader, "queue.SimpleQueue[ReaderEvent]"]]:
    """A reader that reads a unit, and what it hands on."""
    items: queue.SimpleQueue[ReaderEvent] = queue.SimpleQueue()
    with served(VirtualUnit(Still(), options)) as path, Port(path, 38400) as port:
        Imu400cd(port).open(38400)
        clock = Clock(4.7e6, COUNTER, polled=poll_hz is not None)
        reader = Reader(Imu400cd(port), Stamper(clock), poll_hz, items.put)
        reader.start()
        try:
            yield reader, items
        finally:
            reader.stop()
            while reader.is_alive():
                items.get(timeout=10.0) if not items.empty() else None


def packets(items: "queue.SimpleQueue[ReaderEvent]", n: int) -> list[Block]:
    """The next blocks with so many packets; nothing else may come."""
    found = list[Block]()
    while sum(len(block.rows) for block in found) < n:
        item = items.get(timeout=20.0)
        if not isinstance(item, Broke):  # a loaded machine may be late for a poll
            assert isinstance(item, Block)
            found.append(item)
    return found


def rows(blocks: list[Block]) -> np.ndarray:
    """The packets of some blocks."""
    return np.concatenate([block.rows for block in blocks])


def test_a_block_is_of_half_a_second_and_shorter_while_it_is_watched() -> None:
    with reading(UnitOptions(), None) as (reader, items):
        packets(items, 70)  # the first ones wait for those that vouch for them
        unwatched = packets(items, 150)
        reader.be_watched()
        packets(items, 70)
        watched = packets(items, 20)
    assert max(len(block.rows) for block in unwatched) > 30
    assert min(len(block.rows) for block in watched) < 15


def until_zeroed(items: "queue.SimpleQueue[ReaderEvent]") -> tuple[list[Block], ZeroingFinished]:
    """Packets up to the zeroing, and how that went."""
    before: list[Block] = []
    while True:
        item = items.get(timeout=60.0)
        assert not isinstance(item, LineLost)
        if isinstance(item, ZeroingFinished):
            return before, item
        if isinstance(item, Block):
            before.append(item)


@pytest.mark.parametrize("poll_hz", [None, 50.0])
def test_after_zeroing_the_rates_are_zero_and_no_packet_is_missed(poll_hz: float | None) -> None:
    with reading(UnitOptions(), poll_hz) as (reader, items):
        first = packets(items, 30)
        assert np.all(np.abs(rows(first)["counts"][:, :3]) > 10)
        reader.zero(20)
        rest, done = until_zeroed(items)
        after = packets(items, 60)
    assert done.argument == 20
    # ten samples of 7.5 ms for each unit of the argument
    assert done.seconds is not None
    assert done.seconds > 1.3
    assert np.all(np.abs(rows(after)["counts"][:, :3]) <= 1)
    blocks = [*first, *rest, *after]
    assert sum(block.bad_checksums + block.discarded_bytes for block in blocks) == 0
    assert not any(block.gap for block in blocks)
    assert np.all(np.diff(rows(blocks)["stamp_ns"]) > 0)


def test_a_unit_that_does_not_answer_is_given_up_and_heard_again_when_it_wakes(monkeypatch: pytest.MonkeyPatch) -> None:
    """It averages for 6 s where 2.3 s were thought enough: no answer is said, and its packets come when it is done."""
    monkeypatch.setattr(driver, "_ZEROING_MARGIN_S", 1.5)
    with reading(UnitOptions(zero_samples_per_unit=800), None) as (reader, items):
        packets(items, 10)
        reader.zero(1)
        _, gone = until_zeroed(items)
        after = packets(items, 10)
    assert gone.seconds is None
    assert np.all(np.abs(rows(after)["counts"][:, :3]) <= 1)
    assert "power it off and on" in gone.in_words(None, 1.5)


def test_zero_erases_the_stored_zero_at_once() -> None:
    with reading(UnitOptions(), None) as (reader, items):
        packets(items, 5)
        for argument in (2, 0):
            reader.zero(argument)
            _, done = until_zeroed(items)
            assert done.seconds is not None
        after = packets(items, 5)
    assert np.all(np.abs(rows(after)["counts"][:, :3]) > 10)


def test_the_wait_is_as_long_as_the_slowest_document_says() -> None:
    """100 samples a unit of the argument at 133 Hz: 192 s for 255; never less than 10 s."""
    assert Imu400cd.zeroing_patience_s(255) > 255 * 100 / 133.0
    assert Imu400cd.zeroing_patience_s(0) >= 10.0
    for argument in (-1, 256):
        with pytest.raises(ValueError, match="one byte"):
            Imu400cd.check_zeroing(argument)
