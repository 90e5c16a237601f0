"""A start that times out leaves a recording that holds something, or nothing at all."""

import sys
from pathlib import Path

import pytest
from helpers.processes import started

from imutui.logbook import summary
from imutui.session import client, end_report
from imutui.session.plan import VIRTUAL_PORT, Plan

# as an acquisition that is held up for ever with its file just made, or with something in it
HELD_UP = """
import signal, sys, time
from pathlib import Path
from imutui.logbook import schemas
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
signal.signal(signal.SIGTERM, signal.SIG_IGN)
writer = LogWriter(Path(sys.argv[1]), SessionInfo(), "", time.time_ns())
if sys.argv[2] == "one":
    now = time.time_ns()
    writer.message(schemas.EVENTS, schemas.event(now, "mark", "here"), now, now)
    writer.flush()
print("ready", flush=True)
signal.pause()
"""


@pytest.mark.parametrize("messages", ["none", "one"])
def test_a_file_without_a_message_is_not_left_and_one_with_a_message_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: str
) -> None:
    monkeypatch.setattr(end_report, "_GRACE_S", 0.1)
    log = tmp_path / "made" / "for it" / "a.mcap"
    missing = end_report.missing_folders(Plan(VIRTUAL_PORT, output=str(log)))
    assert missing == [log.parent, log.parent.parent]
    with started([sys.executable, "-c", HELD_UP, str(log), messages]) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        assert log.exists()
        end_report.end_unbegun(process, missing)
    if messages == "none":
        assert list(tmp_path.iterdir()) == []
    else:
        assert summary.read(log).state == summary.UNFINISHED


def test_a_start_that_times_out_is_ended_in_order(home: Path) -> None:
    with pytest.raises(client.SessionError, match="did not begin within 0 s"):
        client.start(Plan(VIRTUAL_PORT, logs=str(home / "logs"), record=True), timeout=0.0)
    assert not (home / "logs").exists()
    assert client.running() == []
