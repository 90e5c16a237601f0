"""Commands that are printed to be copied: a shell reads the words they were made of, and the command takes them."""

import ast
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from helpers.commands import imutui
from helpers.modules import MODULES, tree_of
from helpers.paths import SAMPLE
from helpers.traces import replayed
from hypothesis import given, settings
from hypothesis import strategies as st

from imutui import cli
from imutui.command_line import command, joined
from imutui.plain_text import in_line, visible

NAMES = (
    "plain.mcap",
    "with blanks  two.mcap",
    "cut $(touch x).mcap",
    'quote\'s "double".mcap',
    "back`touch x`tick.mcap",
    "-o.mcap",
    "--force",
    "semi;colon&|>.mcap",
    "back\\slash!.mcap",
    "ünï \u202e.mcap",
    "two\nlines\tand.mcap",
    "esc\x1b[31m\x1b]0;title\x07.mcap",
    "bytes\udcff\udc80.mcap",
    "",
)


def read_back(text: str) -> list[str]:
    """Words that a shell makes of a command."""
    line = ["bash", "-c", f"printf '%s\\0' {text}"]
    done = subprocess.run(line, capture_output=True, check=True, env={"LC_ALL": "C.UTF-8"})
    assert not done.stderr
    return [word.decode("utf-8", "surrogateescape") for word in done.stdout.split(b"\0")[:-1]]


def parsed(text: str) -> typer.Context:
    """What the command's own parser makes of a command; it refuses a wrong usage."""
    program, name, *words = shlex.split(text)
    assert program == "imutui"
    group = typer.main.get_command(cli._program(cli.COMMANDS))
    return group.commands[name].make_context(name, words)  # type: ignore[attr-defined, no-any-return]


def commands_in(text: str) -> list[str]:
    """Commands in a message."""
    return re.findall(r"`(imutui [^`]+)`", text)


def test_a_shell_reads_the_words_back() -> None:
    assert read_back(joined(*NAMES)) == [*NAMES]
    assert read_back(joined(*map(Path, NAMES))) == [f"./{name}" if name[:1] == "-" else name or "." for name in NAMES]
    assert command("recover", Path("a.mcap"), "-o", "OUT") == "imutui recover a.mcap -o OUT"


words = st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0")), min_size=1, max_size=8)


@settings(max_examples=40)
@given(words)
def test_no_word_acts_on_a_shell_or_a_terminal(words: list[str]) -> None:
    line = joined(*words)
    assert visible(line) == in_line(line) == line
    assert "`" not in line
    assert read_back(line) == words
    if all(in_line(word) == word and "`" not in word for word in words):
        assert shlex.split(line) == words


@pytest.mark.parametrize("name", [name for name in NAMES if name.endswith(".mcap") and "\n" not in name])
def test_a_damaged_log_of_any_name_is_recovered_by_the_printed_command(name: str, home: Path) -> None:
    (home / name).write_bytes(SAMPLE.read_bytes()[:60_000])
    for asked in ("check", "replay") if "$" in name else ("check",):
        done = imutui(asked, "--", name, check=1)
        assert "\x1b" not in done.stdout + done.stderr
        text = re.sub(r"\s*\n\s*", " ", done.stdout + done.stderr)
        (line,) = {line for line in commands_in(text) if " recover " in line}
        _, _, file, *_ = read_back(line)
        assert Path(file) == Path(name)
    assert not (home / "x").exists()


PRINTERS: dict[str, Callable[[str], str]] = {}


def known_by_name(printer: Callable[[str], str]) -> Callable[[str], str]:
    PRINTERS[printer.__name__] = printer
    return printer


@known_by_name
def port_in_use(name: str) -> str:
    from imutui.session import client

    return client._in_use("/dev/ttyUSB0", name)


@known_by_name
def left(name: str) -> str:
    from imutui.tui import messages

    (_, said) = messages.left({"name": name, "recording": None, "ends_unwatched_s": None})  # type: ignore[typeddict-item]
    return "".join(f"`{line.strip()}`" for line in re.split(r"[A-Z][a-z ]+: ", said) if line)


@known_by_name
def left_rack(name: str) -> str:
    from imutui.tui import messages

    (_, said) = messages.left_rack(name, 2)
    return "".join(f"`{line.strip()}`" for line in re.split(r"[A-Z][a-z ]+: ", said) if line)


@known_by_name
def previous_log(name: str) -> str:
    from imutui.logbook import summary
    from imutui.logbook.session_info import SessionInfo
    from imutui.session import metadata

    previous = summary.Summary(Path("logs", f"{name}.mcap"), state=summary.UNFINISHED)
    return metadata.continuation(metadata.naming(SessionInfo(), previous), previous)


@known_by_name
def replay_report(name: str) -> str:
    from imutui.report.replay_report import after_replay

    document = {**replayed(), "log": f"/data/{name}.mcap", "damage": "cut", "alarms": ["gx is off"]}
    return " ".join(after_replay(document))  # type: ignore[arg-type]


@known_by_name
def table(name: str) -> str:
    done = imutui("table", "move", "--controller", "acutrol://127.0.0.1:1", "--", name, check=2)
    return f"`{done.stderr.partition('Type: ')[2].strip()}`"


@pytest.mark.parametrize("printer", PRINTERS)
@pytest.mark.parametrize("name", ["investigate unit 7 0a1b2c3d", "$(touch x)", "it's", "-x"])
def test_printed_commands_are_right_usage(printer: str, name: str) -> None:
    lines = commands_in(PRINTERS[printer](name))
    assert lines
    for line in lines:
        parsed(line)
        said = shlex.split(line)
        assert printer == "table" or any(name in word for word in said), line


PLACED = re.compile(rf"\bimutui (?:{'|'.join(cli.COMMANDS)})\b[^`\n.;,]*\0|(?<![\w-])(?:--name|--batch|-o) \0")
"""A command, or an option of one, with something put into it."""


def test_every_printed_command_is_quoted() -> None:
    """Nothing but `command_line` puts names into commands, or quotes words for a shell."""
    found = []
    for module in MODULES:
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.JoinedStr):
                text = "".join(part.value if isinstance(part, ast.Constant) else "\0" for part in node.values)
                found += [f"{module}:{node.lineno}: {line[0]}" for line in PLACED.finditer(text)]
            elif isinstance(node, ast.Import) and any(one.name == "shlex" for one in node.names):
                found += [] if module == "imutui.command_line" else [f"{module}:{node.lineno}: shlex"]
            elif isinstance(node, ast.ImportFrom) and node.module == "shlex":
                found.append(f"{module}:{node.lineno}: shlex")
    assert found == []
