"""Lines of a width: no word stands alone on the last one, and what follows a column stays under it."""

import re
import textwrap

_COLUMN = 17  # the most characters that a first column with its blanks takes
_GAP = re.compile(r"\S {2,}(?=\S)")
_FEWEST = 3
_CODE, _QUOTED = re.compile("`[^`\n]*`"), re.compile(r"\$'(?:\\.|[^'\\])*'|'[^']*'")
_BLANK = "\0"  # stands for a blank at which no line may end


def wrap(text: str, width: int, initial_indent: str = "", subsequent_indent: str = "") -> list[str]:
    """Lines of at most `width` characters, but for a word that is longer: a path stays whole, to be copied.

    A quoted word of a command, in backticks, stays whole too.
    """
    lines = textwrap.wrap(
        _CODE.sub(_kept, text),
        width,
        initial_indent=initial_indent,
        subsequent_indent=subsequent_indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    lines = [line.replace(_BLANK, " ") for line in lines]
    if len(lines) < 2 or len(lines[-1].split()) > 1 or len(lines[-2].split()) < _FEWEST:
        return lines
    before, _, word = lines[-2].rpartition(" ")
    last = f"{subsequent_indent}{word} {lines[-1].strip()}"
    return [*lines[:-2], before.rstrip(), last] if len(last) <= width else lines


def _kept(code: re.Match[str]) -> str:
    return _QUOTED.sub(lambda word: word[0].replace(" ", _BLANK), code[0])


def fill(text: str, width: int, initial_indent: str = "", subsequent_indent: str = "") -> str:
    """As `wrap`, as one text."""
    return "\n".join(wrap(text, width, initial_indent, subsequent_indent))


def reflowed(text: str, width: int) -> str:
    """Each line of a text wrapped to a width; what a line goes on with stands under its last column near the left."""
    return "\n".join(made for line in text.split("\n") for made in _reflowed(line, width))


def _reflowed(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    indent = " " * min(_hang(line), width // 3)
    return wrap(line, width, subsequent_indent=indent) or [""]


def joined(text: str) -> str:
    """A text that stands in lines of a fixed width as paragraphs of one line each, to be wrapped anew."""
    made: list[str] = []
    for line in text.split("\n"):
        if made and _continues(made[-1], line):
            made[-1] = f"{made[-1]} {line.strip()}"
        else:
            made.append(line)
    return "\n".join(made)


def _continues(before: str, line: str) -> bool:
    """Whether a line goes on with the one before it: further in, or beside it where neither has a column."""
    if not before.strip() or not line.strip() or _hang(line) != _indent(line):
        return False
    if _indent(line) > _indent(before):
        return _hang(before) > _indent(before)
    is_sentence = before.rstrip().endswith((".", ":")) or before.isupper()
    return _indent(line) == _indent(before) == _hang(before) and not is_sentence


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _hang(line: str) -> int:
    """Where a line's text begins: behind its first column, if it has one."""
    ends = [gap.end() for gap in _GAP.finditer(line) if gap.end() <= _COLUMN]
    return ends[-1] if ends else _indent(line)
