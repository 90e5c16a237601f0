"""The stream of an acquisition: how packets become blocks, what a break does to each consumer, where reports go."""

from pathlib import Path

import numpy as np
import pytest
from helpers.acquisitions import unread
from helpers.blocks import block_of, blocks_of

from imutui.instrument.clock import Clock, Gap, Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.instrument.imu400.driver import COUNTER
from imutui.logbook import reader
from imutui.logbook.session_info import SessionInfo
from imutui.session.acquisition import Acquisition
from imutui.session.plan import Plan, RecordingWish
from imutui.session.reader_thread import ZeroingFinished
from imutui.session.reconnection import LineLost, LineReturned
from imutui.session.stream import WARNING, Block, Broke, PacketArrival, Said, Stamper, Why

PERIOD_NS = 7_500_000


def packet(k: int) -> Packet:
    return Packet(Mode.SCALED, (k % 300, 0, 0), (0, 0, 5461), 1550, -75 * k % 65536)


def acquiring(folder: Path) -> Acquisition:
    plan = Plan("virtual", filter="none", logs=str(folder), min_free_mb=0.0)
    return unread(plan, SessionInfo(filter="none", rate_hz=133.0))


def take(acquisition: Acquisition, first: int, count: int, gap: Gap | None = None) -> None:
    """Packets at 133 Hz from now on."""
    at = [acquisition.started_ns + k * PERIOD_NS for k in range(first, first + count)]
    stamps = [Stamp(stamp_ns, False, gap=gap if stamp_ns == at[0] else None) for stamp_ns in at]
    for block in blocks_of([(packet(first + k), stamp, at[k] + 5_000_000) for k, stamp in enumerate(stamps)]):
        acquisition.take(block)


def lose(acquisition: Acquisition) -> None:
    acquisition.take(LineLost("gone.", acquisition.started_ns, final=False))
    acquisition.take(LineReturned("it was sending still"))


# how the stream breaks → what of it goes on: means of the last seconds, Allan deviation and spectrum, the run of
# samples; and how many packets are lost for certain
BREAKS = {
    "none": (True, True, True, 0),
    "gap": (True, False, True, 3),
    "unanswered": (True, False, True, 1),
    "zeroed": (False, False, False, 0),
    "returned": (False, False, True, 0),
}


@pytest.mark.parametrize("how", BREAKS)
def test_each_consumer_goes_on_after_a_break_or_begins_anew(tmp_path: Path, how: str) -> None:
    acquisition = acquiring(tmp_path)
    take(acquisition, 0, 100)
    run, gap = acquisition.recording.run, None
    match how:
        case "gap":
            gap = Gap(0.03, 3, 3)
        case "unanswered":
            acquisition.take(Broke(Why.UNANSWERED))
        case "zeroed":
            acquisition.take(ZeroingFinished(20, 2.0))
        case "returned":
            lose(acquisition)
    take(acquisition, 103, 40, gap)
    recent, statistics = acquisition.recent, acquisition.channel_statistics(0)
    mean = recent.mean()
    assert mean is not None
    goes_on = bool(mean[0] < recent.series(0)["values"][100][0])
    same_run = acquisition.recording.run is run
    assert (goes_on, statistics["stretches"] == 1, same_run, acquisition.recording.run.counters.lost_packets) == BREAKS[
        how
    ]


def test_a_zeroing_that_the_line_interrupted_begins_the_run_anew(tmp_path: Path) -> None:
    """Whether the rates are zeroed is not known: biases on either side do not belong together."""
    acquisition = acquiring(tmp_path)
    take(acquisition, 0, 20)
    run = acquisition.recording.run
    lose(acquisition)
    assert acquisition.recording.run is run
    acquisition.reader.zero = lambda _: None  # type: ignore[method-assign]
    take(acquisition, 30, 20)
    asked = acquisition.begin_zeroing(20)
    acquisition.take(LineLost("gone.", acquisition.started_ns, final=False))
    assert acquisition.recording.run is not run
    with pytest.raises(ValueError, match="when the unit is back"):
        asked.result(0.0)


def test_a_report_is_in_the_file_behind_its_packet_and_among_the_events_of_viewers(tmp_path: Path) -> None:
    acquisition = acquiring(tmp_path)
    take(acquisition, 0, 20)
    path = acquisition.recording.record(RecordingWish())
    take(acquisition, 20, 20)
    take(acquisition, 43, 20, Gap(0.0225, 3, 3))
    acquisition.mark("here")
    acquisition.take(Said("health", "a channel is dead", WARNING))
    acquisition.stop_recording()
    texts = [event["text"] for event in acquisition.events.events()]
    log = reader.read(path, raw=True)
    said = [(event.name, event.text) for event in log.events]
    assert [name for name, _ in said[-3:]] == ["gap", "mark", "health"]
    begins = texts.index(said[0][1])
    assert [text for _, text in said] == texts[begins : begins + len(said)]
    assert acquisition.events.marks(acquisition.recording.run.started_ns)[0]["text"] == "here"
    # the packet behind the gap was read before the gap was reported, and the next one after it
    (gap,) = [event.stamp_ns for event in log.events if event.name == "gap"]
    assert np.count_nonzero(log.samples.stamp_ns < gap) == 21


def test_packets_are_one_block_up_to_a_gap_or_damage_of_the_line() -> None:
    made = blocks_of(
        [(packet(k), Stamp(k * PERIOD_NS, False, gap=Gap(0.1, 2, 3) if k == 7 else None), k) for k in range(12)]
    )
    assert [block.rows.size for block in made] == [7, 5]
    assert [block.gap for block in made] == [None, Gap(0.1, 2, 3)]
    assert np.array_equal(np.concatenate([block.rows["host_ns"] for block in made]), np.arange(12))

    stamper = Stamper(Clock(0.0, COUNTER, polled=True))
    for k, (bad, discarded, doubled) in enumerate([(0, 0, 0), (0, 0, 0), (1, 18, 0), (1, 18, 0), (1, 20, 2)]):
        stamper.take(PacketArrival(packet(k), k, True, False, False, bad, discarded, doubled))
    counted = [(len(b.rows), b.bad_checksums, b.discarded_bytes, b.doubled) for b in stamper.blocks()]
    assert counted == [(2, 0, 0, 0), (2, 1, 18, 0), (1, 0, 2, 2)]


def test_a_block_is_cut_without_doubling_what_was_before_it() -> None:
    block = block_of(packet(0), Stamp(0, False, gap=Gap(0.1, 2, 3)), 0)
    whole = Block(np.concatenate([block.rows] * 3), block.gap, 1, 18, 0)
    first, rest = whole.cut(1)
    assert (first.rows.size, first.gap, first.bad_checksums) == (1, block.gap, 1)
    assert (rest.rows.size, rest.gap, rest.bad_checksums, rest.discarded_bytes) == (2, None, 0, 0)
