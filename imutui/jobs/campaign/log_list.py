"""Which logs a campaign is of: found in folders and by patterns, told by their paths below one root, divided in shards.

What it leaves out: whether they are logs at all. That is seen when they are read, and is a row of its own.
"""

import glob
import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from filters.errors import InputError
from imutui.logbook.reader import UnreadableLogError

SUFFIX = ".mcap"
_SHARD = re.compile(r"([0-9]{1,7})/([0-9]{1,7})")


@dataclass(frozen=True, slots=True)
class LogList:
    """Logs below a root."""

    root: str  # absolute path of a folder
    logs: tuple[str, ...]  # paths relative to it, with slashes, in order

    def path(self, log: str) -> str:
        """Absolute path of one of them."""
        return f"{self.root.rstrip('/')}/{log}"

    def below(self, root: str) -> "LogList":
        """The same logs told from another root above them, or as they are if it is not above all of them."""
        if self.root == root or os.path.commonpath([self.root, root]) != root:
            return self
        prefix = os.path.relpath(self.root, root)
        return LogList(root, tuple(f"{prefix}/{log}" for log in self.logs))


@dataclass(frozen=True, slots=True)
class Shard:
    """One part of the logs in several: number `number` of `of`, counted from 1."""

    number: int
    of: int

    def __str__(self) -> str:
        """As it is given to --shard."""
        return f"{self.number}/{self.of}"

    def has(self, log: str) -> bool:
        """Whether a log belongs to it: by its path below the root alone, so that no other log moves it."""
        digest = hashlib.sha256(os.fsencode(log)).digest()
        return int.from_bytes(digest[:8], "big") % self.of == self.number - 1


def parse_shard(text: str) -> Shard:
    """Shard of "i/n", i from 1 to n.

    Raises InputError if the text does not read so.
    """
    found = _SHARD.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise InputError(f'--shard is "{text}", not i/n with i from 1 to n, such as 1/4, 2/4, 3/4 and 4/4')
    return Shard(int(found[1]), int(found[2]))


def find(arguments: Sequence[str]) -> LogList:
    """Logs that arguments name.

    `arguments`: folders, of which all `*.mcap` at any depth are taken except hidden ones; files, whatever their names;
      and patterns as shells know them, `**` for any depth.
    Raises UnreadableLogError if an argument names nothing, or there is no log in any.
    """
    bases: list[Path] = []
    paths: set[str] = set()
    for argument in arguments:
        found = _named(argument)
        if not found:
            raise UnreadableLogError(f"{argument}: there is no such file or folder. Check the name.")
        bases.append(_base(argument))
        for path in found:
            paths.update(_logs_in(path) if path.is_dir() else (str(path),))
    if not paths:
        raise UnreadableLogError(f"{', '.join(arguments)}: there is no log (*{SUFFIX}) in it. Name the logs' folder.")
    root = os.path.commonpath(bases)
    return LogList(root, tuple(sorted(os.path.relpath(path, root) for path in paths)))


def _absolute(name: str) -> Path:
    """Without following links: on another machine the same name may lead through others."""
    return Path(os.path.normpath(Path(name).absolute()))


def _named(argument: str) -> list[Path]:
    """What an argument names: itself, even if it looks like a pattern, or what matches it."""
    if Path(argument).exists():
        return [_absolute(argument)]
    if not glob.has_magic(argument):
        return []
    return [_absolute(name) for name in glob.glob(argument, recursive=True)]  # noqa: PTH207 - it may be absolute


def _base(argument: str) -> Path:
    """Folder that an argument stands for: itself, a file's, or that before a pattern's first sign."""
    path = _absolute(argument)
    if path.exists():
        return path if path.is_dir() else path.parent
    fixed = next(k for k, part in enumerate(path.parts) if glob.has_magic(part))
    return Path(*path.parts[:fixed])


def _logs_in(folder: Path) -> Iterator[str]:
    for where, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if name.endswith(SUFFIX) and not name.startswith("."):
                yield f"{where}/{name}"
