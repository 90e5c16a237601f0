"""Text from outside, made fit to be shown and kept: no character in it acts on a terminal, a page or a file.

Notes, names of operators and files, what a unit says of itself, metadata and events of logs: whoever wrote them may
have put in what moves a cursor, changes a colour, rings, or turns the order of letters round. Every way out of the
program takes its text through `visible`, and what comes in by hand or by wire is made one line of bounded length by
`one_line`. Documents in JSON keep the data itself, since JSON writes such characters as escapes anyway.
"""

import json
import re

NAME_LIMIT = 200
"""Longest operator, place, table, version text; characters."""
NOTE_LIMIT = 1000
"""Longest note, mark and event; characters."""
MESSAGE_LIMIT = 4000
"""Longest message to the user that quotes something; characters."""

_CUT, _MASK = "…", "�"
# C0 but tab and newline, DEL, C1; soft hyphen; marks, embeddings, overrides and isolates of writing direction; line
# separators; zero-width space, byte order mark, interlinear annotation; tags; halves of pairs, as names of files have
_ACTING = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U000e0000-\U000e007f\ud800-\udfff]"
)
_BLANKS = re.compile("[\t\n\r]+")
_FILE_NAME_BYTES = range(0xDC80, 0xDD00)


def visible(text: str) -> str:
    r"""Text in which what acts instead of showing stands as an escape such as `\x1b`; newlines and tabs stay.

    Once more over the same text it changes nothing.
    """
    return text if text.isascii() and text.isprintable() else _ACTING.sub(_escape, text)


def in_line(text: str) -> str:
    r"""As `visible`, for a place of one line: newlines and tabs stand as `\n`, `\t` too."""
    return visible(text).replace("\n", r"\n").replace("\t", r"\t")


def masked(text: str) -> str:
    """Text of the same number of characters: one sign in the place of each that acts instead of showing."""
    return _ACTING.sub(_MASK, _BLANKS.sub(" ", text))


def one_line(text: str, limit: int) -> str:
    """Text as it is taken in: newlines and tabs become blanks, the rest as `visible`, and it is cut to a length.

    `text`: from a form, a command, a request, an instrument.
    `limit`: longest, characters; what is cut ends with an ellipsis.
    """
    # a text of any length costs no more than what is kept of it
    return cut(visible(_BLANKS.sub(" ", text[: 4 * limit]).strip()), limit)


def cut(text: str, limit: int) -> str:
    """Text of at most so many characters, the end left out."""
    return text if len(text) <= limit else text[: limit - 1] + _CUT


def quoted(text: str) -> str:
    r"""A basic string of TOML: what acts instead of showing is escaped, and reads back as it was.

    Halves of pairs, which TOML cannot hold, are left as `visible` shows them.
    """
    whole = "".join(_escape_of(c) if "\ud800" <= c <= "\udfff" else c for c in text)
    return _ACTING.sub(lambda match: rf"\U{ord(match[0]):08x}", json.dumps(whole, ensure_ascii=False))


def _escape(match: "re.Match[str]") -> str:
    return _escape_of(match[0])


def _escape_of(character: str) -> str:
    code = ord(character)
    if code in _FILE_NAME_BYTES:  # a byte of a file's name that is no text
        return rf"\x{code - 0xDC00:02x}"
    return rf"\x{code:02x}" if code < 0x100 else rf"\u{code:04x}" if code < 0x10000 else rf"\U{code:08x}"
