"""The acquisition process on a virtual instrument's pseudo-terminal: real processes, real signals, real files."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import imutui, wait_until
from tap import packets_of

from imutui.logbook import reader
from imutui.logbook.results import TIMINGS
from imutui.session import client, wire
from imutui.session.client import SessionError, SessionGoneError
from imutui.session.plan import Plan, RecordingWish


@contextmanager
def virtual(*arguments: str) -> Iterator[str]:
    """A virtual instrument in a process of its own; yields its port."""
    command = [sys.executable, "-m", "imutui", "virtual", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as unit:
        assert unit.stdout is not None
        try:
            yield unit.stdout.readline().strip()
        finally:
            unit.terminate()


def plan(home: Path, **fields: Any) -> Plan:
    return Plan(**({"port": "virtual", "logs": str(home / "logs"), "record": True} | fields))


def replayed(log: str | Path, code: int = 0) -> dict[str, Any]:
    return dict(json.loads(imutui("replay", str(log), "--json", check=code).stdout))


def without_timings(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key not in TIMINGS}


@pytest.mark.parametrize(
    ("rate", "sampling", "seconds"),
    [(133.0, "stream", 4.0), (20.0, "stream", 4.0), (20.0, "polled", 4.0), (1.0, "polled", 6.0)],
)
def test_live_and_replayed_results_are_equal(home: Path, rate: float, sampling: str, seconds: float) -> None:
    """Every field but the timings, at every way of sampling; the measured rate is the asked one."""
    connection = client.start(plan(home, rate_hz=rate, sampling=sampling, duration_s=seconds))
    live = connection.wait(60.0)
    assert live is not None
    assert without_timings(live) == without_timings(replayed(live["log"], code=1))
    assert live["rate_hz"] == pytest.approx(rate, rel=0.02)
    assert live["lost_packets"] == live["bad_checksums"] == 0
    assert live["kind"] == "simulated"


def test_a_measured_recording_played_to_the_wire_comes_back_count_for_count(
    home: Path, recording: Callable[[str], Path]
) -> None:
    """Recorded counts are the bytes the virtual unit sent, in order, none missing; live equals replayed."""
    source = recording("aceinna_imu381_s1_static.npz")
    with virtual("--from", str(source), "--tap", str(home / "sent")) as port:
        asked = plan(home, port=port, rate_hz=20.0, duration_s=30.0, accel_sign=1, mount="x,-y,-z", reference="gravity")
        live = client.start(asked).wait(120.0)
    assert live is not None
    log = reader.read(Path(live["log"]), raw=True)
    assert [(*p.counts, p.temperature, p.ticks) for p in log.raw] == packets_of(home / "sent")[: len(log.raw)]
    assert [p.sequence for p in log.raw] == list(range(len(log.raw)))
    assert len(log.raw) >= 30 * 133
    assert without_timings(live) == without_timings(replayed(live["log"]))
    assert live["unobservable"] == ["accel_bias_x", "accel_bias_y"]
    assert live["kind"] == "unknown"
    with np.load(source) as measured:
        still = measured["gyro"][: 30 * 20].mean(axis=0)
    assert np.allclose(live["final"]["gyro_bias_dps"], still, atol=0.015)


def test_kill_nine_loses_a_second_at_most(home: Path) -> None:
    """What was recorded up to the last flush is read from the unfinished file; the viewer is told; nothing lives on."""
    connection = client.start(plan(home))
    wait_until(lambda: connection.snapshot(2**62)["packets"] > 5 * 133)
    state = connection.snapshot(2**62)
    path = Path(state["recording"]["path"])
    children = [int(p) for p in Path(f"/proc/{connection.pid}/task/{connection.pid}/children").read_text().split()]
    os.kill(connection.pid, signal.SIGKILL)
    with pytest.raises(SessionGoneError, match="imutui replay"):
        while True:
            connection.snapshot()
    result = replayed(path, code=1)
    assert not result["finished"]
    assert result["samples"] >= state["recording"]["samples"] - 2 * 133
    assert result["duration_s"] > state["recording"]["seconds"] - 2.0
    wait_until(
        lambda: (
            not any(
                Path(f"/proc/{child}/cmdline").exists() and Path(f"/proc/{child}/cmdline").read_text()
                for child in children
            )
        )
    )
    assert client.running() == []


def test_a_demo_recovers_known_biases(home: Path) -> None:
    """The main job, whole: exit 0, biases within 3 sd of the truth, sds below 0.6 mg and 0.05 deg/s, a finished log."""
    result = json.loads(imutui("demo", "--headless", "--seconds", "60", "--seed", "7", "--json").stdout)
    for key, limit in (("accel_bias_mg", 0.6), ("gyro_bias_dps", 0.05)):
        error = np.array(result["final"][key]) - result["truth"][key]
        assert np.all(np.abs(error) < 3 * np.array(result["sd"][key]))
        assert np.all(np.array(result["sd"][key]) < limit)
        assert None not in result["converged_s"][key.rsplit("_", 1)[0]]
    assert result["finished"]
    assert result["truth"].keys() == result["final"].keys()
    assert result["kind"] == "simulated"
    assert reader.read(Path(result["log"])).finished
    assert without_timings(replayed(result["log"])) == {
        k: v for k, v in without_timings(result).items() if k != "truth"
    }


def test_a_recording_is_started_marked_and_finished_from_outside(home: Path) -> None:
    """Commands in other processes see the acquisition, mark it and end it; the marks are in the file."""
    connection = client.start(plan(home, record=False, rate_hz=20.0))
    assert "not recording" in imutui("status").stdout
    assert imutui("mark", "too early", check=4).stderr.count("recorded") == 1
    path = connection.record(RecordingWish(note="first run"))
    assert Path(path).name.endswith("_first-run.mcap")
    imutui("mark", "table at 90 deg")
    wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > 20)
    status = json.loads(imutui("status", "--json").stdout)[0]
    assert status["recording"]["path"] == path
    result = json.loads(imutui("stop", "--json").stdout)
    assert result["log"] == path
    log = reader.read(Path(path))
    assert [e.text for e in log.events if e.name == "mark"] == ["table at 90 deg"]
    assert log.info.note == "first run"
    assert log.finished
    assert client.running() == []


def test_each_recording_of_an_acquisition_is_a_log_of_its_own(home: Path) -> None:
    """Stopping and starting again makes two files; each replays to its own live result."""
    connection = client.start(plan(home, rate_hz=50.0))
    results = []
    for _ in range(2):
        wait_until(lambda: (connection.snapshot(2**62)["recording"] or {}).get("samples", 0) > 60)
        results.append(connection.stop_recording())
        connection.record()
    connection.stop()
    assert len({r["log"] for r in results}) == 2
    for result in results:
        assert without_timings(result) == without_timings(replayed(result["log"], code=1))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_to_end_finishes_the_file(home: Path, number: signal.Signals) -> None:
    """SIGTERM and SIGINT to the acquisition: an indexed file."""
    connection = client.start(plan(home, rate_hz=20.0))
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 20)
    path = connection.snapshot(2**62)["recording"]["path"]
    os.kill(connection.pid, number)
    wait_until(lambda: client.running() == [])
    assert reader.read(Path(path)).finished


def test_a_hangup_does_not_end_the_acquisition(home: Path) -> None:
    """A closed terminal sends SIGHUP; recording goes on."""
    connection = client.start(plan(home, rate_hz=20.0))
    os.kill(connection.pid, signal.SIGHUP)
    before = connection.snapshot(2**62)["recording"]["samples"]
    wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > before + 20)
    connection.stop()


def test_one_acquisition_a_name(home: Path) -> None:
    """A second of the same name is refused with what to do; another name runs beside it."""
    first = client.start(plan(home, rate_hz=20.0))
    with pytest.raises(SessionError, match="imutui attach"):
        client.start(plan(home, rate_hz=20.0))
    second = client.start(plan(home, rate_hz=20.0, name="second"))
    assert client.running() == ["default", "second"]
    with pytest.raises(SessionError, match="--name"):
        client.attach()
    second.stop()
    assert client.attach().pid == first.pid
    first.stop()


def test_nobody_else_may_talk_to_it(home: Path) -> None:
    """Folder and socket are the user's alone."""
    connection = client.start(plan(home, rate_hz=20.0))
    assert stat.S_IMODE(wire.folder().stat().st_mode) == 0o700
    assert stat.S_IMODE(wire.socket_path("default").stat().st_mode) == 0o600
    connection.stop()


def test_a_folder_with_a_long_path_holds_a_socket_too(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Socket addresses end at 108 bytes; folders need not."""
    deep = home / ("x" * 120)
    deep.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    connection = client.start(plan(home, rate_hz=20.0))
    assert client.attach().pid == connection.pid
    connection.stop()


def test_a_viewer_that_sends_nonsense_harms_nobody(home: Path) -> None:
    """Bytes that are no request get an error for an answer; the acquisition and other viewers go on."""
    connection = client.start(plan(home, rate_hz=20.0))
    for nonsense in (
        b"\xff\x00 nonsense\n",
        b"[]\n",
        b'{"ask": "explode"}\n',
        b'{"ask": "mark"}\n',
        b'{"ask":"snapshot","since":"x"}\n',
    ):
        with wire.connect("default", 5.0) as other:
            other.sendall(nonsense)
            assert not json.loads(other.makefile().readline())["ok"]
    with wire.connect("default", 5.0) as silent:
        assert isinstance(silent, socket.socket)
        assert connection.snapshot()["state"] == "running"
    connection.stop()


def test_the_series_is_handed_out_once(home: Path) -> None:
    """Asking since the last answer's end gives the packets after it: no gap, no repeat."""
    connection = client.start(plan(home, record=False))
    first = connection.snapshot(0)["series"]
    wait_until(lambda: connection.snapshot(2**62)["series"]["next"] > first["next"] + 50)
    second = connection.snapshot(first["next"])["series"]
    assert len(second["t"]) == second["next"] - first["next"]
    t = np.array(first["t"] + second["t"])
    assert np.all(np.diff(t) > 0)
    assert np.median(np.diff(t)) == pytest.approx(0.0075, abs=2e-4)
    connection.stop()


def test_a_device_that_goes_away_ends_in_a_finished_file_and_words(home: Path) -> None:
    """The virtual unit is killed in mid-recording: exit code 4, what to do, and a file with its index."""
    with virtual() as port:
        connection = client.start(plan(home, port=port, rate_hz=20.0))
        wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 20)
        path = connection.snapshot(2**62)["recording"]["path"]
    with pytest.raises(SessionError) as caught:
        for _ in range(1000):
            connection.snapshot()
            connection.wait(30.0)
            time.sleep(0.01)
    assert caught.value.exit_code == 4
    wait_until(lambda: client.running() == [])
    assert reader.read(Path(path)).finished


def test_ctrl_c_in_the_foreground_finishes_the_file(home: Path) -> None:
    """`record` interrupted: exit 130, the result on stdout, the file finished."""
    command = [sys.executable, "-m", "imutui", "record", "--port", "virtual", "--rate", "20", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as record:
        wait_until(lambda: client.running() == ["default"])
        connection = attached()
        wait_until(lambda: connection.snapshot(2**62)["recording"]["samples"] > 20)
        record.send_signal(signal.SIGINT)
        out, err = record.communicate(timeout=60)
    assert record.returncode == 130, err
    assert "Traceback" not in err
    assert reader.read(Path(json.loads(out)["log"])).finished


def attached() -> client.Client:
    """The running acquisition, as soon as it answers."""
    deadline = time.monotonic() + 30.0
    while True:
        try:
            return client.attach()
        except SessionError:
            assert time.monotonic() < deadline
            time.sleep(0.05)


def test_a_viewer_that_waits_piece_by_piece_leaves_nothing_behind(home: Path) -> None:
    """As `record` does in a terminal: no thread and no open socket stays in the acquisition for each time it looked."""
    connection = client.start(plan(home, rate_hz=20.0))
    process = Path(f"/proc/{connection.pid}")
    before = len(list((process / "task").iterdir())), len(list((process / "fd").iterdir()))
    for _ in range(20):
        with pytest.raises(TimeoutError):
            connection.wait(0.01)
    wait_until(lambda: (len(list((process / "task").iterdir())), len(list((process / "fd").iterdir()))) <= before)
    connection.stop()
