"""Several units as one batch: one table, one command for all, and the trouble of one is not the others'."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.commands import imutui, imutui_json
from helpers.documents import dwell, profile_toml
from helpers.fake_devices import Device, Habits, answers
from helpers.processes import LIMIT_S, command_line, has_ended, started, wait_until
from helpers.units import Still, healthy, served

from imutui.cli.virtual_readings import SIMULATED
from imutui.instrument.imu400.unit import UnitOptions, VirtualUnit
from imutui.instrument.port import PortInfo
from imutui.instrument.uut.unit import VirtualUnit as VirtualUut
from imutui.instrument.uut.unit_options import UnitOptions as UutOptions
from imutui.logbook import reader
from imutui.session import client, ipc

TEXT = """
rate = 20.0
filter = "none"
note = "two of them"
operator = "ana"
[[unit]]
port = "{home}/one"
[[unit]]
port = "{home}/two"
name = "left"
mount = "x,-y,-z"
"""
FAULTY = """
[[unit]]
port = "{home}/three"
[[unit]]
port = "{home}/four"
instrument = "imu381"
[[unit]]
port = "{silent}"
"""


@contextmanager
def two_units(home: Path) -> Iterator[None]:
    """At `one` an IMU400CD of the number 41, at `two` an IMU381 of the number 42."""
    one = VirtualUnit(healthy(), UnitOptions(version=SIMULATED, serial_number=41))
    two = VirtualUut(healthy(), UutOptions(text="IMU381ZA-200 VIRTUAL SIM", serial_number=42))
    with served(one, link=home / "one"), served(two, link=home / "two"):
        yield


def table(home: Path, text: str = TEXT) -> Path:
    path = home / "ten units.toml"
    path.write_text(text.format(home=home))
    return path


@contextmanager
def recording(home: Path, text: str = TEXT, *more: str, names: tuple[str, ...] = ("1", "left")) -> Iterator["Record"]:
    """`imutui record --batch` in a process of its own, once those units record."""
    line = command_line("record", "--batch", str(table(home, text)), "--json", *more)
    with (home / "said.txt").open("w") as said, started(line, stderr=said) as process:
        wait_until(lambda: process.poll() is not None or all(samples(name) > 5 for name in names))
        assert process.poll() is None, (home / "said.txt").read_text()
        yield Record(process, home / "said.txt")


class Record:
    def __init__(self, process: "subprocess.Popen[str]", said: Path) -> None:
        self.process, self._said = process, said

    def said(self) -> str:
        return self._said.read_text()

    def send(self, number: signal.Signals) -> None:
        # it follows by then
        wait_until(lambda: self.said().count("recording to") >= 2)
        self.process.send_signal(number)

    def ended(self, code: int) -> dict[str, dict[str, object]]:
        """Its document by name of the acquisition, the last one's of each."""
        out, _ = self.process.communicate(timeout=LIMIT_S)
        assert self.process.returncode == code, self.said()
        assert "Traceback" not in self.said()
        return {end["name"]: end for end in json.loads(out)}


def samples(name: str) -> int:
    """How many a unit of the batch has recorded by now."""
    try:
        return (client.attach(f"ten-units:{name}").snapshot(2**62)["recording"] or {}).get("samples", 0)
    except client.SessionError:
        return 0


def log_of(end: dict[str, object]) -> reader.Log:
    result = end["result"]
    assert isinstance(result, dict)
    return reader.read(Path(result["log"]))


def test_each_unit_has_its_log_and_one_that_fails_keeps_nobody_from_it(home: Path) -> None:
    other = VirtualUnit(Still(), UnitOptions(version=SIMULATED, serial_number=43))
    with two_units(home), served(other, link=home / "four"), Device(Habits()) as silent:
        text = TEXT + FAULTY.replace("{silent}", silent.port)
        with recording(home, text, "--note", "by hand", "--duration", "3") as record:
            ends = record.ended(4)
    logs = {name: log_of(ends[f"ten-units:{name}"]) for name in ("1", "left")}
    assert all(log.finished for log in logs.values())
    assert {log.info.batch for log in logs.values()} == {"ten-units"}
    assert [log.info.serial_number for log in logs.values()] == ["41", "42"]
    assert [log.info.mount for log in logs.values()] == ["x,y,z", "x,-y,-z"]
    # the command line wins over the file, and the file over what is configured
    assert {(log.info.note, log.info.operator, log.info.rate_hz) for log in logs.values()} == {("by hand", "ana", 20.0)}
    wrong = {"3": "there is no such port", "4": "Only an imu381 was looked for", "5": "is silent"}
    for name, said in wrong.items():
        assert said in str(ends[f"ten-units:{name}"]["error"])
        assert f"ten-units:{name}: " in record.said()
        assert f"--name {name}`, with --port" in record.said()
    assert set(imutui("status", "--batch", "ten-units", check=4).stdout.splitlines()) >= {
        f"ten-units:{name}: not running. {ends[f'ten-units:{name}']['error']}" for name in wrong
    }


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_finishes_all_files(home: Path, number: signal.Signals, code: int) -> None:
    with two_units(home), recording(home) as record:
        record.send(number)
        ends = record.ended(code)
        assert ipc.names() == []
    assert [log_of(end).finished for end in ends.values()] == [True, True]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_while_one_of_them_connects_ends_all(home: Path, number: signal.Signals, code: int) -> None:
    """What runs has its file finished; what is on its way up is given up; what waits for its turn is not begun."""
    with two_units(home), Device(Habits(answers(), streams=None)) as device:
        device.hold(b"S")
        text = TEXT + f'[[unit]]\nport = "{device.port}"\n'
        with recording(home, text) as record:
            device.wait_until_held()
            record.send(number)
            device.release()
            ends = record.ended(code)
    assert ipc.names() == []
    assert [log_of(ends[f"ten-units:{name}"]).finished for name in ("1", "left")] == [True, True]
    assert "nothing was recorded" in str(ends["ten-units:3"]["error"])
    assert len(list((home / "logs").glob("*.mcap"))) == 2


def test_a_terminal_that_goes_away_leaves_all_running(home: Path) -> None:
    with two_units(home), recording(home) as record:
        record.send(signal.SIGHUP)
        record.process.communicate(timeout=LIMIT_S)
        assert record.process.returncode == 0
        assert ipc.names() == ["ten-units:1", "ten-units:left"]
        ends = imutui_json("stop", "--batch", "ten-units")
    assert [log_of(end).finished for end in ends] == [True, True]


def test_one_that_is_killed_is_told_and_exchanged_while_the_other_goes_on(home: Path) -> None:
    other = VirtualUnit(Still(), UnitOptions(version=SIMULATED, serial_number=43))
    with two_units(home), served(other, link=home / "four"), recording(home) as record:
        wait_until(lambda: record.said().count("recording to") == 2)
        # a second of it is on the disk by then
        wait_until(lambda: samples("left") > 30)
        victim = client.attach("ten-units:left").pid
        os.kill(victim, signal.SIGKILL)
        wait_until(lambda: has_ended(victim) and 'the acquisition "ten-units:left" has ended' in record.said())
        before = samples("1")
        state = {one["name"]: one["state"] for one in imutui_json("status", "--batch", "ten-units", check=4)}
        assert state == {"ten-units:1": "running", "ten-units:left": "ended"}
        again = ("record", "--batch", table(home), "--name", "left", "--port", home / "four")
        with started(command_line(*map(str, again))) as second:
            wait_until(lambda: "ten-units:left runs again" in record.said())
            wait_until(lambda: samples("1") > before and samples("left") > 5)
            # who exchanged it ends what he has started and nothing else
            second.send_signal(signal.SIGINT)
            out, _ = second.communicate(timeout=LIMIT_S)
            assert second.returncode == 130
            assert "ten-units:left" in out
            assert "ten-units:1" not in out
        wait_until(lambda: "1 running" in record.said())
        record.send(signal.SIGINT)
        ends = record.ended(130)
    assert log_of(ends["ten-units:left"]).info.serial_number == "43"
    assert log_of(ends["ten-units:1"]).finished
    [cut] = (home / "logs").glob("imu381_42_*.mcap")
    assert not reader.read(cut).finished
    assert reader.read(cut).seconds().size


def test_marks_and_notes_go_to_all_or_to_those_that_are_chosen(home: Path) -> None:
    with two_units(home), recording(home) as record:
        assert imutui("mark", "at all", "--batch", "ten-units").stdout.count("marked in ten-units:") == 2
        imutui("mark", "at left", "--batch", "ten-units", "--name", "left")
        imutui("mark", "left too", "--name", "ten-units:left")
        imutui("note", "second", "--batch", "ten-units", "--name", "1,left")
        some = imutui("mark", "lost", "--batch", "ten-units", "--name", "1,right", check=4)
        assert "marked in ten-units:1" in some.stdout
        assert 'no acquisition named "ten-units:right"' in some.stderr
        assert "--batch ten-units takes all" in imutui("mark", "which", check=2).stderr
        assert "Running: ten-units" in imutui("mark", "none", "--batch", "nine", check=4).stderr
        told = imutui_json("status", "--batch", "ten-units")
        assert [(one["name"], one["batch"], one["note"]) for one in told] == [
            ("ten-units:1", "ten-units", "second"),
            ("ten-units:left", "ten-units", "second"),
        ]
        text = imutui("stop", "--batch", "ten-units").stdout
        named = [line.partition(": ")[0] for line in text.splitlines() if not line.startswith(" ")]
        assert named == ["ten-units:1", "ten-units:left"]
        ends = record.ended(0)
        assert "ended by the command imutui stop" in record.said()
    marks = {name: [event.text for event in log_of(ends[name]).events if event.name == "mark"] for name in ends}
    assert marks == {"ten-units:1": ["at all", "lost"], "ten-units:left": ["at all", "at left", "left too"]}


def test_asked_again_it_starts_what_does_not_run_as_the_first_command_asked(home: Path) -> None:
    """What only the first command stated holds for the unit that joins; what the second command states is its own."""
    text = "[[unit]]" + TEXT.partition("[[unit]]")[2]
    first = ("--rate", "20", "--note", "first lot", "--operator", "ana", "--filter", "none", "--sampling", "polled")
    with two_units(home), recording(home, text, "--name", "1", *first, names=("1",)) as record:
        line = command_line("record", "--batch", str(table(home, text)), "--operator", "eva")
        with (home / "second.txt").open("w") as said, started(line, stderr=said) as second:
            wait_until(lambda: samples("left") > 5 and "ten-units:left runs, too" in record.said())
            assert "runs already" in imutui("record", "--batch", table(home, text), check=4).stderr
            second.kill()
        record.process.send_signal(signal.SIGINT)
        ends = record.ended(130)
    assert set(ends) == {"ten-units:1", "ten-units:left"}
    joined = (home / "second.txt").read_text()
    assert 'ten-units:left: as the batch began, 20 Hz, polled, filter none, reference level, note "first lot"' in joined
    assert "--operator eva is of this command; the batch began with ana" in joined
    infos = [log_of(ends[f"ten-units:{name}"]).info for name in ("1", "left")]
    assert {(info.note, info.rate_hz, info.sampling, info.filter) for info in infos} == {
        ("first lot", 20.0, "polled", "none")
    }
    assert [info.operator for info in infos] == ["ana", "eva"]


def test_equal_serial_numbers_in_one_batch_are_refused_by_both_names_and_the_others_go_on(home: Path) -> None:
    same = VirtualUut(Still(), UutOptions(text="IMU381ZA-200 VIRTUAL SIM", serial_number=41))
    text = TEXT + '[[unit]]\nport = "{home}/three"\n'
    with (
        two_units(home),
        served(same, link=home / "three"),
        recording(home, text, "--duration", "2", names=("left",)) as record,
    ):
        ends = record.ended(4)
    refused = [name for name, end in ends.items() if end["error"]]
    assert refused in (["ten-units:1"], ["ten-units:3"])  # whichever came second
    said = str(ends[refused[0]]["error"])
    assert '"ten-units:1"' in said
    assert '"ten-units:3"' in said
    assert "the same serial number, 41" in said
    assert f"--name {refused[0].partition(':')[2]}`, with --port" in record.said()
    assert all(log_of(end).finished for name, end in ends.items() if name not in refused)
    assert len(list((home / "logs").glob("*.mcap"))) == 2


def test_one_profile_serves_all_each_with_its_mounting(home: Path) -> None:
    """Both read +1 g on Z, one as what stands level, one as what lies upside down, and is mounted so."""
    (home / "one.toml").write_text(profile_toml(dwell(30.0), align="marks"))
    text = 'profile = "one.toml"\n' + TEXT.replace('filter = "none"', 'filter = "spkf"')
    with two_units(home), recording(home, text) as record:
        imutui("mark", "segment 1", "--batch", "ten-units")
        wait_until(lambda: all(samples(name) > 100 for name in ("1", "left")))
        record.send(signal.SIGTERM)
        ends = record.ended(1)
    for end in ends.values():
        log = log_of(end)
        assert log.info.reference == "profile"
        assert "segment 1" in [event.text for event in log.events]
        result = end["result"]
        assert isinstance(result, dict)
        assert abs(result["final"]["accel_bias_mg"][2]) < 100.0


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("[[unit]]\n", 3, "[[unit]] 1 has no `port` or `serial`"),
        ('rate = 500.0\n[[unit]]\nport = "{home}/one"\n', 3, "ten units.toml: `rate` is 500 Hz"),
        ('profile = "none.toml"\n[[unit]]\nport = "{home}/one"\n', 3, "none.toml: No such file"),
        ('profile = "level"\n[[unit]]\nport = "{home}/one"\n', 3, '`profile` is "level", no'),
        (TEXT + '[[unit]]\nport = "/a"\neffects = "none.toml"\n', 3, "[[unit]] 3: --effects {home}/none.toml: No such"),
        (TEXT + '[[unit]]\nport = "/a"\nmount = "-x,y,z"\n', 3, "[[unit]] 3: "),
    ],
)
def test_nothing_is_started_when_the_file_is_wrong(home: Path, text: str, code: int, said: str) -> None:
    done = imutui("record", "--batch", table(home, text), check=code)
    assert str(home / "ten units.toml") in done.stderr
    assert said.format(home=home) in done.stderr
    assert "Nothing was started" in done.stderr
    assert not (home / "logs").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--port", "/a"], "--port is of one unit"),
        (["-o", "a.mcap"], "-o is of one unit"),
        (["--name", "right"], 'has no unit "right"; it has: 1, left.'),
    ],
)
def test_what_is_of_one_unit_is_refused_for_all(home: Path, more: list[str], said: str) -> None:
    assert said in imutui("record", "--batch", table(home), *more, check=2).stderr


def test_whoever_names_no_unit_is_told_how() -> None:
    said = imutui("record", check=2).stderr
    assert "--port" in said
    assert "--batch FILE" in said


def test_a_table_is_made_of_what_answers_and_units_are_found_by_their_numbers(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ports of this machine are those of the units, as if they were adapters."""
    with two_units(home):
        ports = [PortInfo(str(home / name), str(home / name), "adapter") for name in ("one", "two", "none")]
        monkeypatch.setattr("imutui.instrument.port.available", lambda: ports)
        imutui("devices", "--probe", "-o", home / "found.toml", check=1)
        text = (home / "found.toml").read_text()
        assert "IMU381ZA-200 #42 at" in text
        assert [line for line in text.splitlines() if "=" in line] == ['serial = "41"', 'serial = "42"']
        assert "exists" in imutui("devices", "--probe", "-o", home / "found.toml", check=2).stderr
        (home / "found.toml").write_text('filter = "none"\n' + text + '[[unit]]\nserial = "43"\n')
        done = imutui("record", "--batch", home / "found.toml", "--duration", "1", "--json", check=4)
        ends = {end["name"]: end for end in json.loads(done.stdout)}
        assert "the serial number 43 answers" in ends["found:43"]["error"]
        assert f"{home}/two (42)" in ends["found:43"]["error"]
        assert [log_of(ends[f"found:{number}"]).info.serial_number for number in (41, 42)] == ["41", "42"]
        imutui("devices", home / "one", "-o", home / "one.toml")
    assert 'serial = "41"' in (home / "one.toml").read_text()
