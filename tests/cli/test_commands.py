"""The commands, as a user runs them."""

import json
import os
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import serial
from helpers.commands import imutui, imutui_json, imutui_process
from helpers.fake_client import FakeClient
from helpers.paths import SAMPLE
from helpers.processes import LIMIT_S, virtual_process
from rosbags.highlevel import AnyReader

from imutui.cli import COMMANDS, each_log, exit_codes, status
from imutui.instrument.uut.frames import Frame, framed
from imutui.instrument.uut.messages import PacketS1, encode, numbers, pairs
from imutui.logbook import schemas
from imutui.session.batch import Answer

ACEINNA = ("--accel-sign", "+1", "--mount", "x,-y,-z", "--reference", "gravity")
ADIS = ("--accel-sign", "+1", "--reference", "gravity")


def still(path: Path, seconds: float = 30.0) -> Path:
    """A simulated still recording at 20 Hz with the Crossbow's sign."""
    rng = np.random.default_rng(4)
    n = int(seconds * 20)
    gyro = rng.normal(size=(n, 3)) * 0.075 * np.sqrt(20) + [0.5, -0.3, 0.1]
    accel = rng.normal(size=(n, 3)) / 60 * np.sqrt(20) / 9.80665 + [0.004, -0.002, 0.99793 + 0.006]
    np.savez(path, t=np.arange(n) / 20.0, gyro=gyro, accel=accel)
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str) -> None:
    text = imutui(command, "--help").stdout
    assert f"Example: imutui {command}" in " ".join(text.split())


@pytest.mark.parametrize(
    ("line", "code"), [("replay --help", 0), (f"info {SAMPLE}", 0), ("info none.mcap", 3), ("replay --nonsense", 2)]
)
def test_a_process_ends_as_a_call_does(home: Path, line: str, code: int) -> None:
    """Streams and exit code of a command are those that its call in this process has, as in most of these tests."""
    called, run = imutui(*line.split(" "), check=code), imutui_process(*line.split(" "), check=code)
    assert (run.stdout, run.stderr) == (called.stdout, called.stderr)


@pytest.mark.parametrize(("left_s", "said"), [(1800.0, "30 min"), (3599.0, "60 min"), (9000.0, "2.5 h")])
def test_status_says_for_how_long_the_disk_has_room(left_s: float, said: str) -> None:
    fake = FakeClient()
    fake.record()
    snapshot = fake.snapshot()
    assert snapshot["recording"] is not None
    snapshot["recording"]["to_full_s"] = left_s
    assert f"full in {said} at 6.1 kB/s" in status._text(Answer(fake.name, snapshot))


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_on_a_terminal_until_the_next_word(
    monkeypatch: pytest.MonkeyPatch, is_terminal: bool
) -> None:
    screen = StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: is_terminal)
    monkeypatch.setattr(sys, "stderr", screen)
    each_log.progress(0.25, "sample.mcap")
    exit_codes.say("done")
    exit_codes.say("and more")
    shown = "\r\x1b[K 25 %  sample.mcap\r\x1b[K" if is_terminal else ""
    assert screen.getvalue() == f"{shown}done\nand more\n"


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_message_breaks_no_word_on_a_terminal(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> None:
    screen = StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: is_terminal)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("COLUMNS", "80")
    said = "connecting to its instrument " * 9
    exit_codes.say(said.strip())
    lines = screen.getvalue().splitlines()
    assert (max(map(len, lines)) <= 80) == is_terminal
    assert " ".join(lines) == said.strip()


def test_an_aceinna_recording_gives_sensible_biases(home: Path, recording: Callable[[str], Path]) -> None:
    source = recording("aceinna_imu381_s1_static.npz")
    done = imutui("import", source, "-o", "a.mcap", *ACEINNA, "--kind", "measured")
    assert "temps" in done.stderr, "an array that was not imported is named"
    result = imutui_json("replay", "a.mcap")
    with np.load(source) as measured:
        gyro, accel = measured["gyro"].mean(axis=0), measured["accel"].mean(axis=0)
    assert np.allclose(result["final"]["gyro_bias_dps"], gyro, atol=0.015)
    assert result["final"]["accel_bias_mg"][:2] == [None, None]
    vertical = (np.linalg.norm(accel) - 0.99793) * 1e3
    assert result["final"]["accel_bias_mg"][2] == pytest.approx(vertical, abs=0.5)
    assert result["unobservable"] == ["accel_bias_x", "accel_bias_y"]
    assert result["converged_s"]["gyro_bias"] == [20.0, 20.0, 20.0]
    assert result["nis"]["dof"] == 7
    assert not result["nis"]["is_test"]
    assert result["gaps"] == []
    assert result["kind"] == "measured"


def test_an_adis_recording_gives_sensible_biases(home: Path, recording: Callable[[str], Path]) -> None:
    source = recording("adis16405_static_a.npz")
    imutui("import", source, "-o", "a.mcap", "--end", "600", *ADIS)
    result = imutui_json("replay", "a.mcap", "--end", "60", check=1)
    # accelerometers move by more in this minute than their biases are known to
    assert ("ax", "moving") in [(one["channel"], one["kind"]) for one in result["health"]]
    assert {one["kind"] for one in result["health"]} == {"moving"}
    with np.load(source) as measured:
        gyro = measured["gyro"][:6001].mean(axis=0)
    assert result["samples"] == 6001
    assert np.allclose(result["final"]["gyro_bias_dps"], gyro, atol=0.02)
    assert -25.0 < result["final"]["accel_bias_mg"][2] < -15.0
    assert result["converged"]
    assert all(1.0 < n < 4.5 for n in result["noise"]["gyro_arw_deg_sqrt_h"])


def test_estimates_are_written_where_asked_and_open_elsewhere(home: Path) -> None:
    imutui("import", still(home / "a.npz"), "-o", "a.mcap")
    result = imutui_json("replay", "a.mcap", "-o", "est.mcap", "--estimates", "10")
    with AnyReader([home / "est.mcap"]) as bag:
        estimates = [bag.deserialize(data, c.msgtype) for c, _, data in bag.messages() if c.topic == schemas.ESTIMATE]
    assert len(estimates) == pytest.approx(300, abs=2)
    assert np.allclose(estimates[-1].gyro_bias_dps, result["final"]["gyro_bias_dps"], atol=0.002)
    assert list(estimates[-1].converged) == [True] * 6


def test_settings_change_a_replay_and_its_configuration_hash(home: Path) -> None:
    imutui("import", still(home / "a.npz"), "-o", "a.mcap")
    plain = imutui_json("replay", "a.mcap")
    paper = imutui_json("replay", "a.mcap", "--set", "filter.kappa=-12")
    drawn = imutui_json("replay", "a.mcap", "--set", "filter.measurements=drawn", "--set", "filter.seed=3", check=None)
    assert plain["log_sha256"] == paper["log_sha256"]
    assert len({r["config_sha256"] for r in (plain, paper, drawn)}) == 3
    assert np.allclose(plain["final"]["gyro_bias_dps"], paper["final"]["gyro_bias_dps"], atol=1e-4)
    assert drawn["nis"]["is_test"]
    assert drawn["seed"] == 3
    low, high = drawn["nis"]["band95"]
    assert low - 1.0 < drawn["nis"]["mean"] < high + 1.0


def test_several_logs_give_a_list(home: Path) -> None:
    for name in ("a", "b"):
        imutui("import", still(home / f"{name}.npz", 3.0), "-o", f"{name}.mcap")
    results = imutui_json("replay", "a.mcap", "b.mcap", check=1)
    assert [Path(r["log"]).name for r in results] == ["a.mcap", "b.mcap"]


def test_a_table_for_people_says_the_verdict_first(home: Path) -> None:
    imutui("import", still(home / "a.npz"), "-o", "a.mcap", "--kind", "simulated")
    text = imutui("replay", "a.mcap").stdout
    assert text.startswith(("GREEN, converged: ", "AMBER, converged: "))
    assert "SIMULATED" in text
    assert all(f"{axis} {kind}" in text for axis in "xyz" for kind in ("gyro", "accel"))


def test_configuration_says_where_each_value_comes_from(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "imutui.toml").write_text('[paths]\nlogs = "from-file"\n[acquisition]\nrate_hz = 20\nnonsense = 1\n')
    monkeypatch.setenv("IMUTUI_ACQUISITION_RATE_HZ", "50")
    done = imutui("config", "--show", "--json")
    settings = json.loads(done.stdout)
    assert settings["acquisition.rate_hz"] == {"value": 50.0, "source": "IMUTUI_ACQUISITION_RATE_HZ"}
    assert settings["paths.logs"]["value"] == "from-file"
    assert settings["filter.name"]["source"] == "default"
    assert "nonsense" in done.stderr


def test_the_virtual_instrument_answers_on_its_link_and_names_what_it_heard(home: Path) -> None:
    with virtual_process("--link", "imu", "--serial-number", "42") as (port, unit):
        assert os.path.realpath(home / "imu") == port
        with serial.Serial(str(home / "imu"), 38400, timeout=5.0) as line:
            line.write(b"R")
            assert line.read(1) == b"H"
            line.write(b"S")
            assert line.read(6) == bytes([0xFF, 0, 0, 0, 42, 42])
            line.write(b"c")
            assert line.read(1) == b"C"
            line.write(b"G")
            packet = line.read(18)
        unit.terminate()
        _, heard = unit.communicate(timeout=LIMIT_S)
    assert packet[0] == 0xFF
    assert sum(packet[1:17]) % 256 == packet[17]
    assert [text.split(":")[0] for text in heard.splitlines()] == ["R", "S", "c", "G"]
    assert not (home / "imu").is_symlink()


def test_a_recorded_stream_is_played_byte_for_byte(home: Path) -> None:
    packets = [PacketS1((k, 0, 0), (0, 0, 0), (0, 0, 0), 0, k * 655 % 65536, 2) for k in range(20)]
    stream = b"".join(map(encode, packets))
    (home / "a.raw").write_bytes(stream)
    with virtual_process("--from", "a.raw") as (port, _), serial.Serial(port, 115200, timeout=LIMIT_S) as line:
        identity = (2008705635).to_bytes(4, "big") + b"IMU381ZA-400 5020-1383-01 10.00.01"
        line.write(encode(Frame(b"GP", b"ID")))
        assert line.read(7 + len(identity)) == framed(Frame(b"ID", identity))
        line.write(encode(Frame(b"SF", pairs(((1, 1),)))))
        assert line.read(10 + len(stream)) == encode(Frame(b"SF", numbers((1,)))) + stream


def test_a_played_recording_is_silent_after_its_end(home: Path) -> None:
    still(home / "a.npz", 1.0)
    with virtual_process("--from", "a.npz") as (port, _), serial.Serial(port, 38400, timeout=3.0) as line:
        line.write(b"c")
        assert line.read(1) == b"C"
        line.write(b"C")
        stream = line.read(100_000)
        line.write(b"R")
        assert line.read(1) == b"H"
    assert len(stream) % 18 == 0
    assert len(stream) // 18 == pytest.approx(0.95 * 400 / 3, abs=2)
