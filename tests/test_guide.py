"""The guide does what it says: its commands are typed as they stand, and its words are compared with what comes."""

import difflib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.places import own_places
from helpers.processes import LIMIT_S, end_owner

GUIDE = (Path(__file__).parents[1] / "docs" / "guide.md").read_text()
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
_PATH = re.compile(r"\S*/\S*\.mcap")
_WORD = re.compile(r"[A-Za-z][\w-]*")
_NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?!\w)")
_SPEED = " --speed 2"


class Section:
    """A section of the guide by its heading: what it has typed, the files that it has written, what it shows."""

    def __init__(self, heading: str) -> None:
        self.heading = heading
        (self.text,) = re.findall(rf"^##+ (?:\d+\. )?{heading}\n(.*?)(?=^##)", GUIDE, flags=re.DOTALL | re.MULTILINE)
        self.blocks = _BLOCK.findall(self.text)

    def commands(self) -> list[str]:
        """Its commands in their order, each a line."""
        lines = [line for kind, block in self.blocks if kind == "sh" for line in block.splitlines()]
        return [line for line in lines if line.strip()]

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
        self.environment = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}", "COLUMNS": "80"}

    def types(self, command: str, codes: tuple[int, ...] = (0,)) -> str:
        """Type a command; returns what it prints."""
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=self.environment, capture_output=True, text=True,
            timeout=LIMIT_S,
        )  # fmt: skip
        assert done.returncode in codes, f"`{command}` of docs/guide.md ends with {done.returncode}: {done.stderr}"
        assert "Traceback" not in done.stderr
        return done.stdout


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
    """A reader who has made the recording of the second section, twice as fast as its unit would."""
    folder = tmp_path_factory.mktemp("guide")
    with pytest.MonkeyPatch.context() as patch:
        runtime = own_places(patch, folder)
        made = Reader(folder)
        (command,) = Section("Record a minute").commands()
        made.recorded = made.types(command + _SPEED)  # type: ignore[attr-defined]
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
