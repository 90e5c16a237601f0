"""A clock that stamps of ROS cannot hold: recording goes on with stamps that fit, and one sentence says so."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import ros_messages
from helpers.acquisitions import acquiring
from helpers.commands import imutui, imutui_json, imutui_process
from helpers.units import virtual
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from imutui.logbook import log_time, reader, schemas

_DAY_NS = 86_400_000_000_000
WRONG = {
    "1969": -86_400.0 * 200,
    "1901": -86_400.0 * 25_000,
    "the first second": 0.0,
    "2038": 2.0**31 - 3.0,
    "2071": 3.2e9,
}
SET = "the system's clock is wrong: "


@given(st.integers(-(2**63), 2**63 - 1))
def test_a_time_fits_into_a_log_keeps_its_time_of_day_and_is_moved_only_if_it_must_be(utc_ns: int) -> None:
    fitted = log_time.fitted_ns(utc_ns)
    assert log_time.LEAST_NS <= fitted < log_time.MOST_NS
    assert (fitted - utc_ns) % _DAY_NS == 0
    assert log_time.fitted_ns(fitted) == fitted
    assert bool(log_time.why_fitted(utc_ns)) == (fitted != utc_ns)


@pytest.mark.parametrize("seconds", WRONG.values(), ids=WRONG)
def test_a_recording_begun_by_a_wrong_clock_is_read_by_all_and_says_so_once(
    home: Path, monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    clock, begun = time.time_ns, time.time_ns()
    monkeypatch.setattr(time, "time_ns", lambda: clock() - begun + round(seconds * 1e9))
    with acquiring(home, rotate_minutes=0.0) as run:
        run.engine.call(lambda acquisition: acquisition.mark("here"))
        events, log = run.content()
    assert len([text for text in events if text.startswith(SET)]) == 1
    assert not [text for text in events if "stepped" in text]
    assert len(ros_messages.packets(log)) > 20
    assert np.all(np.diff(log.samples.stamp_ns) > 0)
    with AnyReader([run.first]) as bag:
        found = [(bag.deserialize(data, c.msgtype), at) for c, at, data in bag.messages() if c.topic == schemas.IMU]
    assert len(found) == len(log.samples.stamp_ns)
    assert all(abs(at - m.header.stamp.sec * 10**9 - m.header.stamp.nanosec) < 2e9 for m, at in found)
    assert imutui_json("replay", run.first, "--filter", "none", check=None)["samples"] == len(log.samples.stamp_ns)


@pytest.mark.parametrize("seconds", [WRONG["1901"], WRONG["2071"]])
def test_a_clock_that_is_set_wrong_during_a_recording_ends_nothing(
    home: Path, monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    clock, begun = time.time_ns, time.time_ns()
    with acquiring(home) as run:
        monkeypatch.setattr(time, "time_ns", lambda: clock() - begun + round(seconds * 1e9))
        run.record()
        run.engine.call(lambda acquisition: acquisition.recording._go_on())
        run.record()
        _, log = run.content()
        monkeypatch.undo()
    first = reader.read(run.first)
    assert first.finished
    assert any("the system clock stepped by" in event.text for event in first.events)
    assert 0 < log.samples.stamp_ns[0] - first.samples.stamp_ns[-1] < 1e9


CLOCK = "import time; _f = time.time_ns; time.time_ns = lambda: _f() + {0}; time.time = lambda: time.time_ns() / 1e9"


def test_the_command_records_and_says_so(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "sitecustomize.py").write_text(CLOCK.format(1_400_000_000 * 10**9))
    monkeypatch.setenv("PYTHONPATH", str(home))
    with virtual() as port:
        done = imutui_process("record", "--port", port, "--filter", "none", "--duration", "2", "-o", "a.mcap")
    assert done.stderr.count(SET) == 1
    assert reader.read(home / "a.mcap").finished


@pytest.mark.parametrize("seconds", [WRONG["1969"], WRONG["2071"]])
def test_a_file_of_such_a_time_is_imported_with_a_warning(home: Path, seconds: float) -> None:
    rows = "".join(f"{k / 20},0,0,0,0,0,-1\n" for k in range(40))
    Path("a.csv").write_text(f"t,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n{rows}")
    os.utime("a.csv", (seconds, seconds))
    done = imutui("import", "a.csv", "--accel-sign", "+1", "-o", "a.mcap", check=None)
    assert done.returncode == 0, done.stderr
    assert "outside of what stamps of ROS hold" in done.stderr
    with AnyReader([home / "a.mcap"]) as bag:
        assert len([None for c, *_ in bag.messages() if c.topic == schemas.IMU]) == 40
