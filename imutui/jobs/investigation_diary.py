"""The diary of an investigation: why each motion was made, what was expected of it, what came; and its file.

It is written before and after each motion, and is all that is needed to go on after any stop. What it leaves out: the
rounds (`investigation`).
"""

import contextlib
import json
import math
from pathlib import Path
from typing import Literal, TypedDict, cast

from filters.errors import InputError
from imutui import document_shape, outside_file
from imutui.command_line import command
from imutui.logbook import atomic_file

DIARY = "diary.json"
LAST_GOOD = "diary.before.json"
"""The diary as it was before it was last written."""
NOTHING = "nothing"  # in the place of an effect: that there is none
_LIMIT = 16 * 2**20  # bytes of a diary

Kind = Literal["start", "round", "held_out"]
Outcome = Literal["", "explained", "not_here", "time"]


class RivalsEntry(TypedDict):
    """What may act on a channel: one name, or two of which one is true, and their odds against drift alone."""

    channel: str
    names: list[str]
    odds: list[float]


class RoundEntry(TypedDict):
    """A motion."""

    kind: Kind
    start_s: float  # s since the investigation began
    motion: str  # what the table does, in words
    minutes: float
    expected_bits: float
    why: str  # a sentence
    log: str  # its file in the folder; empty until it is finished
    power_on: int  # which of the unit's, from 0
    rivals: list[RivalsEntry]  # as they are known with it
    status: dict[str, str]  # of each channel, likewise
    came: str  # what came of it, a sentence


class AskedEntry(TypedDict):
    """With what an investigation was begun."""

    port: str
    controller: str
    limits: str
    flags: dict[str, float | str]  # settings that were given, by their keys


class DiaryDocument(TypedDict):
    """All that is known of an investigation."""

    version: int
    hours: float
    spent_s: float  # of these, in all sessions
    power_on: int  # which of the unit's it is now
    outcome: Outcome  # empty while it goes on
    takes: list[str]  # what it would take to explain the rest, sentences
    rounds: list[RoundEntry]
    asked: AskedEntry


class Diary:
    """The diary of an investigation, in a file of its folder; without a folder in memory."""

    def __init__(self, document: DiaryDocument, folder: Path | None, said: str = "") -> None:
        self.document, self.said = document, said
        self._folder = folder

    @classmethod
    def begun(cls, hours: float, folder: Path | None) -> "Diary":
        """A new one; raises InputError if the folder has one."""
        if folder is not None and ((folder / DIARY).exists() or (folder / LAST_GOOD).exists()):
            raise InputError(
                f"{folder / DIARY} is of another investigation. Go on with --resume, or name another folder."
            )
        return cls(
            {
                "version": document_shape.VERSION, "hours": hours, "spent_s": 0.0, "power_on": 0, "outcome": "",
                "takes": [], "rounds": [],
                "asked": {"port": "", "controller": "", "limits": "", "flags": {}},
            },
            folder,
        )  # fmt: skip

    @classmethod
    def read(cls, folder: Path) -> "Diary":
        """Read the diary of a folder, without a round that was cut.

        If it cannot be read, its last good copy takes its place; `said` reports that.
        Raises InputError if there is none.
        """
        path, copy = folder / DIARY, folder / LAST_GOOD
        if not path.is_file() and not copy.is_file():
            raise InputError(f"{folder} has no {DIARY}: there is nothing to go on with. Begin without --resume.")
        try:
            document, said = _document(path), ""
        except (InputError, FileNotFoundError) as error:
            if not copy.is_file():
                raise InputError(f"{error} Name another folder.") from error
            document, said = _document(copy), f"{error} Its last good copy, {copy}, takes its place."
        diary = cls(document, folder, said)
        lost = [r for r in diary.made if not (folder / r["log"]).is_file()]
        if lost:
            raise InputError(f"{folder / lost[0]['log']} is not there, which {path} names. Put it back, or begin anew.")
        diary.document["rounds"] = diary.made
        return diary

    @property
    def made(self) -> list[RoundEntry]:
        """Rounds whose log is whole."""
        return [entry for entry in self.document["rounds"] if entry["log"]]

    def save(self) -> None:
        """Write the diary, whole or not at all; the one before it stays as the last good copy.

        Raises ValueError for a number that is not finite, which no diary may have.
        """
        if self._folder is None:
            return
        text = json.dumps(self.document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        path = self._folder / DIARY
        with contextlib.suppress(InputError, FileNotFoundError):  # what cannot be read is no good copy
            _document(path)
            before = path.read_text(encoding="utf-8", errors="surrogateescape")
            atomic_file.write(self._folder / LAST_GOOD, before, overwrite=True)
        atomic_file.write(path, text, overwrite=True)


def _document(path: Path) -> DiaryDocument:
    """Read the document of a diary; raises InputError if it is none, FileNotFoundError if it is not there."""
    try:
        document = outside_file.read_json(path, _LIMIT)
    except InputError as error:
        raise InputError(f"{path} is no diary: {error}.") from error
    if wrong := document_shape.fault(document, DiaryDocument, "diary"):
        asked = document.get("asked") if isinstance(document, dict) else None
        port, url = (
            str(asked.get(key) or name) if isinstance(asked, dict) else name
            for key, name in (("port", "P"), ("controller", "URL"))
        )
        anew = command("investigate", "--port", port, "--controller", url, "--hours", "H", "-o", "DIR")
        raise InputError(f"{path} is no diary of this imutui: {wrong}. `{anew}` begins anew.")
    made = cast("DiaryDocument", document)
    if not (0.0 < made["hours"] < math.inf and 0.0 <= made["spent_s"] < math.inf):
        raise InputError(f"{path} is no diary: `hours` is {made['hours']} and `spent_s` {made['spent_s']}.")
    return made
