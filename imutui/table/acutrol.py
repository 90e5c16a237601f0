"""Acutrol's dialect: bytes in, frozen commands and answers out, for a host and for a virtual controller.

No input or output and no clock. Bytes that mean nothing raise nothing: they become an `Unknown`, or an answer that is
not what was asked for. What is known of the language was read off two public drivers, see docs/tables.md: a command a
line, words by colons, arguments behind a blank and by commas, several in one line by semicolons, the later ones
relative to the branch of the one before.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

LINE_END = b"\r\n"
TCP_PORT = 9888

PREFIX_CHARACTERS = 8
"""Characters before the text of each answer over TCP. A driver cuts them off; their meaning is not known."""

DONE = "OK"
"""The answer over TCP to a command that asks nothing. Over GPIB there is none."""

LONGEST_LINE = 4096
"""Bytes after which a line without an end is given up; the longest that is sent here has some 120."""

ALL = "all"
"""In place of an axis's number: all axes."""

MODES = ("off", "position", "rate", "synthesis")
"""Modes of an axis, as `:mode? N` answers, where the first letter is large."""

ABSOLUTE_LIMITS = ("rate", "acceleration", "jerk", "low", "high", "trip")
"""What `:limit:absolute? N` answers, in this order: deg and seconds; the last is a rate at which the drive trips."""

_TREE: dict[str, tuple[str, ...]] = {
    "demand": ("position", "rate", "delta", "oscillation"),
    "mode": ("off", "position", "rate", "synthesis"),
    "read": ("position", "rate", "acceleration"),
    "interlock": ("reset", "close", "open"),
    "limit": ("absolute", "rate", "acceleration", "jerk"),
    "utility": ("lockout",),
    "*idn": (),
    "*stb": (),
}
# sent as drivers send them: the full words were never seen
_SENT = {"acceleration": "acc", "oscillation": "osc", "synthesis": "synt"}
_ALONE = ("mode", "interlock", "limit", "*idn", "*stb")
# asked with or without a question mark
_ONLY_ASKED = {("read", each) for each in _TREE["read"]} | {("limit", "absolute"), ("*idn",), ("*stb",)}


@dataclass(frozen=True, slots=True)
class Command:
    """A command or a question."""

    words: tuple[str, ...]  # in full, small: ("demand", "position")
    arguments: tuple[str, ...] = ()  # as they stand on the line, without blanks around them
    asks: bool = False

    def __str__(self) -> str:
        return f"{_head(self.words)}{'?' * self.asks}{self._tail()}"

    def after(self, before: "Command") -> str:
        """How it may stand behind another one in a line: relative to the same branch where it has one."""
        if self.words[:-1] != before.words[:-1] or self.words[0].startswith("*"):
            return str(self)
        return f"{_sent(self.words[-1])}{'?' * self.asks}{self._tail()}"

    def _tail(self) -> str:
        return f" {','.join(self.arguments)}" if self.arguments else ""


@dataclass(frozen=True, slots=True)
class Unknown:
    """A text in place of a command."""

    text: str


AnyCommand: TypeAlias = Command | Unknown


def _head(words: tuple[str, ...]) -> str:
    return words[0] if words[0].startswith("*") else ":" + ":".join(map(_sent, words))


def _sent(word: str) -> str:
    return _SENT.get(word, word)


def demand(what: str, axis: int | str, *values: float) -> Command:
    """Return the demand of an angle, a rate or a swing from an axis: `what` is a word below `demand`."""
    return Command(("demand", what), (str(axis), *map(number, values)))


def mode(which: str, axis: int | str) -> Command:
    """Have an axis enter a mode: one of MODES. It moves to its demand as soon as it is in it."""
    return Command(("mode", which), (str(axis),))


def limit(what: str, of_mode: str, axis: int | str, value: float) -> Command:
    """Set the limit of "rate" or "acceleration" of an axis in a mode ("position", "rate", "synthesis")."""
    return Command(("limit", what), ("pos" if of_mode == "position" else _sent(of_mode), str(axis), number(value)))


def interlock(what: str, axis: int | str) -> Command:
    """Do something to the interlock of an axis: "open", "reset", "close"."""
    return Command(("interlock", what), (str(axis),))


def ask(*words: str, axis: int) -> Command:
    """Ask something of an axis."""
    return Command(words, (str(axis),), asks=True)


IDENTIFY = Command(("*idn",), (), asks=True)


def number(value: float) -> str:
    """A number as it stands on the line, without an exponent: to 1e-5 deg, which is below all encoders."""
    text = f"{value:.5f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def encode(commands: Sequence[Command]) -> bytes:
    """Write commands as one line."""
    words = [str(commands[0])]
    words += [this.after(before) for before, this in itertools.pairwise(commands)]
    return ";".join(words).encode("ascii") + LINE_END


def parse(line: str) -> list[AnyCommand]:
    """Commands of a line: long or short words, large or small, with or without a question mark."""
    found: list[AnyCommand] = []
    branch: tuple[str, ...] = ()
    for piece in line.split(";"):
        command = _parsed(piece.strip(), branch)
        found.append(command)
        if isinstance(command, Command):
            branch = command.words[:-1]
    return found


def _parsed(piece: str, branch: tuple[str, ...]) -> AnyCommand:
    head, _, tail = piece.partition(" ")
    asks, head = head.endswith("?"), head.removesuffix("?").lower()
    arguments = tuple(each.strip() for each in tail.split(",")) if tail.strip() else ()
    spelt = tuple(head.removeprefix(":").split(":"))
    words = _in_full(spelt) if head.startswith((":", "*")) else _in_full((*branch, *spelt)) or _in_full(spelt)
    if words is None:
        return Unknown(piece)
    return Command(words, arguments, asks or words in _ONLY_ASKED)


def _in_full(spelt: tuple[str, ...]) -> tuple[str, ...] | None:
    """Words that are spelt in full or shortened; None where there are no such ones."""
    first = full(spelt[0], _TREE)
    if first is None or len(spelt) > 2:
        return None
    if len(spelt) == 1:
        return (first,) if first in _ALONE else None
    second = full(spelt[1], _TREE[first])
    return None if second is None else (first, second)


def full(word: str, words: Sequence[str] | dict[str, tuple[str, ...]]) -> str | None:
    """The first of some words that a word, large or small, is the beginning of."""
    return next((each for each in words if word and each.startswith(word.lower())), None)


class CommandDecoder:
    """The controller's side: bytes from a host in, lines of commands out."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[list[AnyCommand]]:
        """Take bytes from the line; returns the commands of each line that has ended. Empty lines are none."""
        *lines, self._begun = (self._begun + data).split(b"\n")
        if len(self._begun) > LONGEST_LINE:
            lines, self._begun = [*lines, self._begun], b""
        texts = [line.decode("ascii", "replace").strip() for line in lines]
        return [parse(text) for text in texts if text]


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of a controller to a line."""

    texts: tuple[str, ...]  # one for each question, and over TCP for each command


class AnswerDecoder:
    """The host's side: bytes from a controller in, answers out.

    An answer ends with its line; where it has no line end, when the line is quiet, which is for the caller to tell.

    `prefix`: how many characters stand before the text of each.
    """

    def __init__(self, prefix: int) -> None:
        self._prefix = prefix
        self._begun = b""

    def feed(self, data: bytes) -> Answer | None:
        """Take bytes from the line; returns an answer whose line has ended."""
        self._begun += data
        end = self._begun.find(b"\n", self._prefix)
        if end < 0 and len(self._begun) <= LONGEST_LINE:
            return None
        end = end if end >= 0 else len(self._begun)
        line, self._begun = self._begun[:end], self._begun[end + 1 :]
        return self._answer(line)

    def so_far(self) -> Answer | None:
        """Return the part that has come of an answer whose line has not ended; None if it has no text yet."""
        return self._answer(self._begun) if len(self._begun) > self._prefix else None

    def forget(self) -> None:
        """Drop the bytes so far: they belong to no question that is asked from now on."""
        self._begun = b""

    def _answer(self, line: bytes) -> Answer:
        text = line[self._prefix :].decode("ascii", "replace").strip()
        return Answer(tuple(each.strip() for each in text.split(";")))


def encode_answer(texts: Sequence[str], prefix: bytes, end: bytes) -> bytes:
    """Write an answer as a controller does: `prefix` before its text, `end` behind it."""
    return prefix + ";".join(texts).encode("ascii", "replace") + end
