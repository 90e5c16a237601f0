"""What is loaded before the first packet is on the disk, and what is not."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from imutui.instrument.clock import Stamp
from imutui.instrument.imu400.crossbow import Mode, Packet
from imutui.logbook import schemas
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import live_filter
from imutui.session.sample_pipeline import SamplePipeline
from imutui.session.timebase import Timebase

START = 1_795_257_000_000_000_000
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
    pipeline.packet(Packet(Mode.SCALED, (0, 0, 0), (0, 0, 5461), 1550, 0), Stamp(0, True), 2_000_000)
    assert on_disk == [1]
    assert pipeline.filter is not None
    assert pipeline.filter.estimator is None
