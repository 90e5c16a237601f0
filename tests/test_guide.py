"""The guide does what it says: its commands are typed as they stand, and its words are compared with what comes.

Recordings that take minutes are made for seconds; a log of the same simulated unit then takes their place. What needs
root, a cluster or a table for half an hour is left to other tests.
"""

import difflib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import unit_time
from helpers.places import own_places
from helpers.processes import LIMIT_S, end_owner, started, wait_until
from helpers.terminal import Terminal

from filters.imu import STANDARD_GRAVITY
from filters.simulation import Unit
from imutui.scenario import load_scenario

GUIDE = (Path(__file__).parents[1] / "docs" / "guide.md").read_text()
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
_PATH = re.compile(r"\S*/\S*\.mcap")
_WORD = re.compile(r"[A-Za-z][\w-]*")
_NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?!\w)")


class Section:
    """A section of the guide by its heading: what it has typed, the files that it has written, what it shows."""

    def __init__(self, heading: str) -> None:
        self.heading = heading
        (self.text,) = re.findall(rf"^##+ (?:\d+\. )?{heading}\n(.*?)(?=^##|\Z)", GUIDE, flags=re.DOTALL | re.MULTILINE)
        self.blocks = _BLOCK.findall(self.text)

    def commands(self) -> list[str]:
        """Its commands in their order, each a line."""
        lines = [line for kind, block in self.blocks if kind == "sh" for line in block.splitlines()]
        return [line for line in lines if line.strip()]

    def command(self, *words: str) -> str:
        """Return the command that has all these words, whatever kind of block it is in."""
        lines = [line for _, block in self.blocks for line in block.splitlines()]
        return next(line for line in lines if "imutui" in line and all(word in line for word in words))

    def shown(self) -> str:
        """The output that it shows."""
        return next(block for kind, block in self.blocks if kind == "text")

    def write_files(self, folder: Path) -> None:
        """Write the files that the section has its reader write."""
        for kind, block in self.blocks:
            if kind in ("toml", "python"):
                name = block.split("\n", 1)[0].removeprefix("#").rpartition(":")[2].strip()
                (folder / name).write_text(block)


class Reader:
    """A reader of the guide: a shell in a folder of its own, in which the commands are typed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        tools = folder / "bin"
        tools.mkdir()
        for name, what in (("imutui", "-m imutui "), ("python", "")):
            (tools / name).write_text(f'#!/bin/sh\nexec {sys.executable} {what}"$@"\n')
            (tools / name).chmod(0o755)
        place = {"PATH": f"{tools}:{os.environ['PATH']}", "COLUMNS": "80", "HOME": str(folder)}
        self.environment = {**os.environ, **place}

    def types(self, command: str, codes: tuple[int, ...] = (0,)) -> str:
        """Type a command; returns what it prints."""
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=self.environment, capture_output=True, text=True,
            timeout=LIMIT_S,
        )  # fmt: skip
        assert done.returncode in codes, f"`{command}` of docs/guide.md ends with {done.returncode}: {done.stderr}"
        assert "Traceback" not in done.stderr
        return done.stdout

    @contextmanager
    def begins(self, command: str, output: str) -> "Iterator[subprocess.Popen[str]]":
        """Type a command in another terminal; `output` is the file that has what it prints."""
        with (self.folder / output).open("w") as file:
            options = {"cwd": self.folder, "env": self.environment, "stdout": file, "stderr": subprocess.STDOUT}
            with started(["bash", "-c", f"exec {command}"], **options) as process:
                yield process

    @contextmanager
    def begins_units(self, *commands: str) -> Iterator[None]:
        """Type a command of `imutui virtual`, or several; each has made its link before anything else is typed."""
        links = [self.folder / re.sub(".*--link ", "", command).split()[0] for command in commands]
        if not commands:
            yield
            return
        with self.begins(commands[0], f"virtual_{links[0].name}.txt"), self.begins_units(*commands[1:]):
            wait_until(lambda: all(link.exists() for link in links))
            yield

    def comes(self, command: str, *words: str) -> str:
        """Type a command again and again until what it prints has all these words; returns what it prints."""
        printed = [""]

        def has_come() -> bool:
            printed[0] = self.types(command, (0, 1, 4))
            return all(word in printed[0] for word in words)

        try:
            wait_until(has_come, pause=0.2)
        except AssertionError:
            others = "\n".join(f"{path.name}: {path.read_text()}" for path in self.folder.glob("*.txt"))
            pytest.fail(f"`{command}` of docs/guide.md never prints {words}:\n{printed[0]}\n{others}")
        return printed[0]

    def has_recorded(self, scenario: str, power_on: int, seconds: int, log: str, options: str = "") -> None:
        """Put a log in the place of one that the guide has recorded over minutes: of the same unit, without the wait.

        Readings at seven times 20 Hz are averaged, as the acquisition averages packets.
        """
        unit = Unit(load_scenario(self.folder / scenario), power_on, 140.0)
        axes, made = unit.scenario.axes, unit.record(140 * seconds)
        gyro, accel = axes.gyro_to_instrument(made.samples.gyro), axes.accel_to_instrument(made.samples.accel)
        arrays = {"t": made.samples.t, "gyro": np.rad2deg(gyro), "accel": accel / STANDARD_GRAVITY}
        arrays["temp"] = np.round(16.0 * made.temperature_degc) / 16.0
        means = {name: all_.reshape(-1, 7, *all_.shape[1:]).mean(axis=1) for name, all_ in arrays.items()}
        np.savez(self.folder / "made.npz", **means)
        stated = "--instrument IMU400CD-200 --kind simulated --accel-sign -1 --force"
        self.types(f"imutui import made.npz -o {log} {stated} {options}")


def check_excerpt(shown: str, came: str, command: str) -> None:
    """The words that the guide shows stand in what came, in their order; the guide leaves out lines at an ellipsis."""
    found = _WORD.findall(came)
    for part in shown.split("…\n"):
        words = _WORD.findall(part)
        places = [n for n in range(len(found)) if found[n : n + len(words)] == words]
        assert places, f"docs/guide.md shows other words than `{command}` prints:\n{part}\n{came}"
        found = found[places[0] + len(words) :]


def check_words(shown: str, came: str, command: str) -> None:
    """The words that the guide shows are those that came, in their order; numbers may differ a little."""
    expected, found = (_PATH.sub("", text) for text in (shown, came))
    words, got = _WORD.findall(expected), _WORD.findall(found)
    differ = "\n".join(difflib.unified_diff(words, got[: len(words)], "docs/guide.md", command, lineterm="", n=3))
    assert words == got[: len(words)], f"docs/guide.md shows other words than `{command}` prints:\n{differ}"
    numbers = [float(number) for number in _NUMBER.findall(expected)]
    near = [pytest.approx(number, rel=0.1, abs=0.1) for number in numbers]
    assert [float(number) for number in _NUMBER.findall(found)][: len(near)] == near, f"numbers of `{command}`"


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reader]:
    """A reader who has made the recording of the second section, as fast as the machine makes it."""
    folder = tmp_path_factory.mktemp("guide")
    with pytest.MonkeyPatch.context() as patch:
        runtime = own_places(patch, folder)
        made = Reader(folder)
        (command,) = Section("Record a minute").commands()
        with unit_time.own():
            made.recorded = made.types(command)  # type: ignore[attr-defined]
        yield made
        for lock in (runtime / "imutui").glob("*.lock"):
            end_owner(lock)


def test_the_first_recording_is_green_as_the_guide_shows(reader: Reader) -> None:
    section = Section("Record a minute")
    came: str = reader.recorded  # type: ignore[attr-defined]
    check_words(section.shown(), came, section.commands()[0])


def test_the_file_is_looked_at_as_the_guide_says(reader: Reader) -> None:
    """`replay` gives the biases of the recording to the last digit.

    The setting of the noise may cost convergence, and time that runs twice as fast on a busy computer a finding of
    `check`.
    """
    section = Section("Look at the file")
    found = ("noise=log", "imutui check")
    printed = {
        command: reader.types(command, (0, 1) if any(word in command for word in found) else (0,))
        for command in section.commands()
    }
    came: str = reader.recorded  # type: ignore[attr-defined]
    biases = [" ".join(line.split()[:6]) for line in came.splitlines() if re.match(r"[xyz] (gyro|accel)", line)]
    assert len(biases) == 6
    replayed = " ".join(printed["imutui replay logs/*_demo.mcap"].split())
    assert all(bias in replayed for bias in biases)
    assert "SIMULATED" in printed["imutui info logs/*_demo.mcap"].upper()


@pytest.mark.parametrize("heading", ["A recording made elsewhere", "A recording that broke off"])
def test_the_section_can_be_typed_from_top_to_bottom(reader: Reader, heading: str) -> None:
    """A cut file is a finding for `check`; the recording that is cut in the guide is that of another section."""
    section = Section(heading)
    section.write_files(reader.folder)
    (recording,) = (reader.folder / "logs").glob("*_demo.mcap")
    (reader.folder / "level.mcap").write_bytes(recording.read_bytes())
    for command in section.commands():
        found = command.startswith(("imutui check broken", "imutui replay"))
        reader.types(command.replace("head -c 500000", "head -c 200000"), (0, 1) if found else (0,))
    assert (reader.folder / ("back.csv" if "elsewhere" in heading else "fixed.mcap")).stat().st_size


def test_the_screen_names_what_the_guide_says_that_it_finds() -> None:
    """The demo of the screen has one effect, and the guide promises no GREEN there."""
    text = Section("The same on the screen").text
    assert "gy oscillates at 0.13 Hz" in text
    assert "GREEN" not in text


def ends(terminal: Terminal) -> int | None:
    """Read what the program still writes until it has ended; returns its exit code."""
    wait_until(lambda: terminal.drain(0.1) or terminal.process.poll() is not None)  # type: ignore[func-returns-value]
    return terminal.process.returncode


def test_the_screen_has_what_the_guide_says_of_its_keys(reader: Reader) -> None:
    section = Section("The same on the screen")
    demo, status, attach = section.commands()
    variables = {**reader.environment, "IMUTUI_PATHS_LOGS": "screen_logs"}
    terminal = Terminal(["bash", "-c", demo], cwd=reader.folder, **variables)
    try:
        terminal.read_until("2 Live", "● REC", ">gx")
        for keys, words in (
            ("4", ("AMBER", "converged at", "w why")),
            ("w", ("channels: no fault shows", "close")),
            ("\x1b", ("w why", "x gyro")),
            ("2", (">gx", "trend")),
            ("m", ("Mark",)),
            ("door opened\r", ("door opened",)),
            ("3", ("door opened", "RECORDING")),
            ("r", ("not recording",)),
            ("6", ("newest first", "t traces")),
        ):
            terminal.press(keys.encode())
            terminal.read_until(*words)
        terminal.press(b"d")
        assert ends(terminal) == 0
    finally:
        terminal.close()
    assert "SIMULATED" in reader.types(status, (0, 1)).upper()
    terminal = Terminal(["bash", "-c", attach], cwd=reader.folder, **variables)
    try:
        terminal.read_until("2 Live", ">gx")
        terminal.press(b"q")
        terminal.read_until("leave it", "cancel")
        terminal.press(b"s")
        assert ends(terminal) == 0
    finally:
        terminal.close()


def test_a_port_is_asked_recorded_and_marked_as_the_guide_says(reader: Reader) -> None:
    section = Section("Record from a port")
    virtual, probe, record, status, mark, info = section.commands()
    for left in reader.folder.glob("level.mcap*"):  # of another section, whose reader was here before
        left.unlink()
    with reader.begins_units(virtual):
        assert "IMU400CD-200" in reader.types(probe)
        with reader.begins(record.replace("--duration 90", "--duration 600"), "record.txt") as process:
            reader.comes(status, "recording to", "level.mcap")
            reader.types(mark)
            reader.types(section.text[section.text.index("`imutui stop`") :].split("`")[1], (0, 1))
            process.wait(LIMIT_S)
    printed = reader.types(info)
    assert "door opened" in printed
    assert "ana" in printed
    (reader.folder / "level.mcap").unlink()


def test_a_batch_is_started_joined_and_ended_as_the_guide_says(reader: Reader) -> None:
    section = Section("Several units at once")
    units = re.findall("`(imutui virtual[^`]*)`", section.text)
    devices, record, status, mark, note, stop = section.commands()
    left, joins, _ = section.shown().splitlines()
    with reader.begins_units(*units):
        reader.types(devices)
        with reader.begins(record, "batch.txt") as process:
            reader.comes(status, "rack:9911751 (", "rack:9911752 (")
            reader.types(left, (0, 1))
            with reader.begins(joins, "joined.txt"):
                reader.comes(status, "rack:9911751 (", "rack:9911752 (")
                for command in (mark, note):
                    reader.types(command)
                reader.types(stop, (0, 1))
                process.wait(LIMIT_S)
    assert "as the batch began, 20 Hz" in (reader.folder / "joined.txt").read_text()
    report = re.search("`(imutui report --batch[^`]*)`", section.text)
    assert report is not None
    assert "of 2 units" in reader.types(report[1], (0, 1))


def test_what_is_wrong_with_a_unit_is_found_and_used_as_the_guide_says(reader: Reader) -> None:
    section, use = Section("Find what is wrong with a unit"), Section("Use what was found")
    section.write_files(reader.folder)
    virtual, _, record, _, end, trace = section.commands()[:6]
    short = re.sub("do (imutui record .*) & done", r"do (\1; touch run$k.done) & done", record)
    short = short.replace("> run$k.txt", "> run$k.txt 2>&1")
    assert short.count("run$k") == 4
    typed = [
        virtual,
        "until [ -e unit0 -a -e unit1 -a -e unit2 ]; do sleep 0.1; done",
        short.replace("--duration 180", "--duration 3"),
        "until [ -e run0.done -a -e run1.done -a -e run2.done ]; do sleep 0.1; done",
        end,
    ]
    reader.types("\n".join(typed))
    printed = [(reader.folder / f"run{k}.txt").read_text() for k in range(3)]
    assert all("SIMULATED" in one for one in printed), printed
    for k in range(3):
        reader.has_recorded("warm.toml", k, 180, f"run{k}.mcap")
    check_excerpt(section.shown(), reader.types(trace), trace)
    (block,) = [block for kind, block in section.blocks if kind == "bash"]
    for k, name in enumerate(("before", "after")):
        (reader.folder / f"{name}.mcap").write_bytes((reader.folder / f"run{k}.mcap").read_bytes())
    for command in block.splitlines():
        reader.types(command, (0, 1))
    assert (reader.folder / "page" / "index.html").stat().st_size
    plain, with_effects, apply = use.commands()
    biases = [reader.types(command, (0, 1)) for command in (plain, with_effects)]
    ends = [float(re.findall(r"y gyro +(\S+)", printed)[0]) for printed in biases]
    assert ends == [pytest.approx(-0.28, abs=0.03), pytest.approx(-0.4, abs=0.02)]
    assert "bias follows temperature" in reader.types(apply)


def test_a_moving_table_shows_its_scale_factor_as_the_guide_says(reader: Reader) -> None:
    section = Section("A moving table")
    section.write_files(reader.folder)
    profile, virtual, record, replay, trace = section.commands()
    assert "makes testable: scale factor gz" in reader.types(profile)
    with reader.begins_units(virtual):
        reader.types(record.replace("--duration 120", "--duration 3"), (0, 1))
    reader.has_recorded("moving.toml", 0, 120, "turns.mcap", "--reference table.toml")
    assert "scale factor" in reader.types(replay, (0, 1))
    printed = reader.types(trace)
    assert re.search(r"^gz .*scale factor", printed, flags=re.MULTILINE)
    (value,) = re.findall(r"^gz +scale factor is off \(scale\) +(\S+) ±", printed, flags=re.MULTILINE)
    assert float(value) == pytest.approx(0.01, rel=0.1)


def test_the_unit_and_the_rule_are_installed_as_the_guide_says(reader: Reader) -> None:
    """systemd understands the unit, whose program exists; the rule jumps forward to labels that it has."""
    section = Section("Leave it running")
    (reader.folder / "docs").symlink_to(Path(__file__).parents[1] / "docs")
    for command in section.commands():
        reader.types(command)
    unit = reader.folder / ".config/systemd/user/imutui@.service"
    (program,) = re.findall(r"^ExecStart=(\S+) record --unattended --name %i --port", unit.read_text(), re.MULTILINE)
    assert Path(program).is_file()
    assert "PORT=/dev/ttyUSB0\n" in (reader.folder / ".config/imutui/table.env").read_text()
    rule = (reader.folder / "docs/service/99-imutui.rules").read_text()
    jumps, labels = re.findall(r'GOTO="(\w+)"', rule), re.findall(r'^LABEL="(\w+)"', rule, re.MULTILINE)
    assert set(jumps) == set(labels)
    assert all(rule.rindex(f'GOTO="{label}"') < rule.index(f'LABEL="{label}"') for label in labels)
    if (analyze := shutil.which("systemd-analyze")) is None:
        pytest.skip("systemd-analyze is not here: package systemd")
    environment = reader.environment | {"XDG_RUNTIME_DIR": str(reader.folder)}
    command = [analyze, "verify", "--user", "--man=no", unit]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LIMIT_S)
    assert (done.stdout + done.stderr, done.returncode) == ("", 0)


def test_many_logs_are_rows_and_the_rows_a_fleet_as_the_guide_says(reader: Reader) -> None:
    many, fleet = Section("Many logs"), Section("A fleet of units")
    rows, summary = fleet.commands()
    reader.types(many.command("campaign ~/logs"), (0, 1))
    (script,) = [block for _, block in many.blocks if "--shard" in block]
    script = script.replace("/data/logs", "logs").replace("$SLURM_ARRAY_TASK_ID/64", "1/1")
    reader.types(script.replace("$SLURM_ARRAY_TASK_ID", "1"), (0, 1))
    reader.types(many.command("collect parts").replace("-o results", "-o joined"), (0, 1))
    reader.types(rows, (0, 1))
    reader.types(summary, (0, 1))
    assert (reader.folder / "fleet" / "index.html").stat().st_size
