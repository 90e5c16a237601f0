"""What is no number where an option takes one: answered as a number out of its range is, with what it takes."""

from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperCommand

from imutui.cli.exit_codes import USAGE, fail

_KINDS = {"valid integer": "a whole number", "valid number": "a number", "valid float": "a number"}
"""What versions of typer say of a text that is none, and what it is none of."""


class Command(TyperCommand):
    """A command that says which option got what, and what that option is for."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Parse the arguments; raises the exit for a text where a number belongs."""
        given = list(args)
        try:
            return super().make_context(info_name, args, parent, **extra)
        except typer.BadParameter as error:
            said = _words(error, given, info_name or "")
            if said is None:
                raise
            raise fail(USAGE, said) from error


def _words(error: typer.BadParameter, args: Sequence[str], command: str) -> str | None:
    """What is wrong, or None where it is something else than a number."""
    option: Any = error.param
    kind = next((kind for words, kind in _KINDS.items() if words in str(error)), None)
    found = None if kind is None or option is None else _given(option.opts, args)
    if found is None:
        return None
    name, value = found
    return f'{name} is "{value}", not {kind}. {option.help or ""} All options: imutui {command} -h'.replace("  ", " ")


def _given(names: Sequence[str], args: Sequence[str]) -> tuple[str, str] | None:
    """The option as it was typed, and its value; the last one counts."""
    found = None
    for place, word in enumerate(args):
        name, equals, value = word.partition("=")
        if name in names and equals:
            found = name, value
        elif word in names and place + 1 < len(args):
            found = word, args[place + 1]
    return found
