"""An acquisition that is started again, after it was killed or the computer was, goes on in a new file that says so."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import imutui
from helpers.processes import wait_until
from helpers.units import virtual

from imutui.command_line import joined
from imutui.logbook import reader, summary
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import LogWriter
from imutui.session import client, ipc, metadata
from imutui.session.plan import Plan

NOW = SessionInfo(serial_number="7", acquisition="table", host="here", boot_id="b2", log_id="new")
BEFORE = replace(NOW, log_id="old", boot_id="b1")


def acquired(home: Path, port: str, **fields: Any) -> client.Client:
    return client.start(Plan(port, **({"logs": str(home / "logs"), "record": True, "filter": "none"} | fields)))


def recorded(connection: client.Client, samples: int) -> None:
    """Wait until so many are recorded."""
    wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > samples)


def killed(connection: client.Client) -> Path:
    """Kill the acquisition when it has recorded some; returns its file."""
    recorded(connection, 250)  # a second of them at least is on the disk
    recording = connection.snapshot(2**62)["recording"]
    assert recording is not None
    os.kill(connection.pid, signal.SIGKILL)
    wait_until(lambda: connection.name not in ipc.names())
    return Path(recording["path"])


def finished(connection: client.Client) -> Path:
    """Stop an acquisition; returns its file."""
    recorded(connection, 2)
    result = connection.stop()["result"]
    assert result is not None
    return Path(result["log"])


def written(path: Path, info: SessionInfo, *, end: bool) -> Path:
    """A log without samples, with its end or without."""
    writer = LogWriter(path, info, "", time.time_ns())
    if end:
        writer.finish({}, time.time_ns())
    else:
        writer._file.close()  # as the kernel does for a process that was killed
    return path


def found(folder: Path, *, finished_too: bool = True) -> summary.Summary | None:
    return metadata.previous_log(folder, NOW, finished_too=finished_too)


def test_an_acquisition_that_was_killed_goes_on_in_a_new_file_that_says_so(home: Path) -> None:
    with virtual() as port:
        before = killed(acquired(home, port, name="table"))
        assert ipc.socket_path("table").exists()
        after = finished(acquired(home, port, name="table"))
    old, new = reader.read(before), reader.read(after)
    assert not old.finished
    assert (new.info.previous, new.info.previous_id) == (before.name, old.info.log_id)
    assert (new.info.previous_end, new.info.restart) == ("unfinished", "process")
    assert new.info.boot_id == old.info.boot_id != ""
    said = [event.text for event in new.events if event.text.startswith("continues")]
    assert len(said) == 1
    assert said[0].startswith(f"continues after a crash: {before.name} ended unfinished at 20")
    assert "Whether the unit kept its power is not known" in said[0]
    assert new.info.power_on == new.info.log_id  # nobody knows, so it is not claimed
    assert f"after         {before.name}, unfinished, then a crash" in imutui("info", after).stdout


def test_unattended_a_file_names_the_one_before_though_it_was_finished(home: Path) -> None:
    """Whoever records by hand knows what was before; a chain that goes on by itself is told link by link."""
    with virtual() as port:
        first = finished(acquired(home, port, unattended=True))
        by_itself = finished(acquired(home, port, note="b", unattended=True))
    assert [reader.read(log).info.previous for log in (first, by_itself)] == ["", first.name]
    assert reader.read(by_itself).info.previous_end == "finished"


@pytest.mark.parametrize("end", [False, True])
@pytest.mark.parametrize(("boot", "restart"), [("b1", "computer"), ("b2", "process"), ("", "")])
def test_the_run_of_the_computer_tells_a_crash_from_a_restart(
    tmp_path: Path, boot: str, restart: str, end: bool
) -> None:
    written(tmp_path / "a.mcap", replace(BEFORE, boot_id=boot), end=end)
    previous = found(tmp_path)
    assert previous is not None
    named = metadata.naming(NOW, previous)
    how = "finished" if end else "unfinished"
    assert (named.previous, named.previous_id, named.previous_end, named.restart) == ("a.mcap", "old", how, restart)
    event = metadata.continuation(named, previous)
    assert ("restart of the computer" in event) == (restart == "computer")
    assert ("crash" in event) == (restart == "process" and not end)
    (*_, said) = event.split("known")
    recover = joined("imutui", "recover", tmp_path / "a.mcap", "-o", tmp_path / "a_recovered.mcap")
    assert said == ("" if end else f"; `{recover}` makes it whole")


def test_only_the_last_log_of_the_same_acquisition_unit_and_computer_counts(tmp_path: Path) -> None:
    first = written(tmp_path / "a.mcap", BEFORE, end=False)
    for key, value in (("serial_number", "8"), ("acquisition", "other"), ("host", "there")):
        written(tmp_path / f"{key}.mcap", replace(BEFORE, **{key: value}), end=False)  # type: ignore[arg-type]
    (tmp_path / "empty.mcap").touch()
    writer = LogWriter(tmp_path / "now.mcap", BEFORE, "", time.time_ns())
    previous = found(tmp_path, finished_too=False)
    assert previous is not None
    assert previous.path.name == "a.mcap"
    writer.finish({}, time.time_ns())
    os.utime(first, (1.0, 1.0))
    assert found(tmp_path, finished_too=False) is None
    assert found(tmp_path / "none") is None


def test_a_link_that_leads_nowhere_and_a_pipe_hide_no_log(tmp_path: Path) -> None:
    written(tmp_path / "old.mcap", BEFORE, end=False)
    (tmp_path / "gone.mcap").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "folder.mcap").mkdir()
    previous = found(tmp_path)
    assert previous is not None
    assert previous.path.name == "old.mcap"


def test_what_was_before_a_recording_is_not_said_of_its_later_files() -> None:
    named = metadata.naming(NOW, summary.Summary(Path("a.mcap"), state=summary.UNFINISHED))
    assert (named.previous, named.previous_end) == ("a.mcap", "unfinished")
    assert metadata.naming(named, None) == NOW
