"""Commands that are printed to be copied, quoted so that a shell reads back the words that they were made of.

Names of files, acquisitions and ports may hold blanks, quotes, `$(...)`, a leading dash, line breaks, terminal escapes
and bytes that are no text. No word leaves this module with a character that acts on a shell or on a terminal, and none
holds a backtick, which ends a command in a message.
"""

import os
import shlex
from pathlib import PurePath

from imutui.plain_text import in_line


def command(*words: str | PurePath) -> str:
    """Return an `imutui` command of these words; see `joined`."""
    return joined("imutui", *words)


def joined(*words: str | PurePath) -> str:
    r"""Return words as a line for a shell.

    A plain word stays as it is, so that placeholders such as LOG are readable. A word with characters that act on a
    terminal is written as bash and zsh read it, `$'a\x1bb'`. A `Path` that begins with a dash is written `./-name`,
    since it would be taken for an option.
    """
    return " ".join(_quoted(_text(word)) for word in words)


def _text(word: str | PurePath) -> str:
    text = os.fspath(word)
    return f"./{text}" if isinstance(word, PurePath) and text.startswith("-") else text


def _quoted(text: str) -> str:
    if in_line(text) == text and "`" not in text:
        return shlex.quote(text)
    return f"$'{''.join(map(_escaped, text))}'"


def _escaped(character: str) -> str:
    if character in "\\'":
        return f"\\{character}"
    if character == "`" or in_line(character) != character:
        return "".join(rf"\x{byte:02x}" for byte in _bytes(character))
    return character


def _bytes(character: str) -> bytes:
    # half of a pair stands for a byte of a file's name that is no text, or came from a document and is no name at all
    is_byte = "\udc80" <= character <= "\udcff"
    return character.encode("utf-8", "surrogateescape" if is_byte else "surrogatepass")
