"""Which signs the terminal's font has: braille, block, or plain ASCII."""

import os
from collections.abc import Mapping
from dataclasses import dataclass

_BLOCK = {"▕": "│", "▏": "│", "●": "■", "…": "~", "▲": "^"}
_ASCII = {
    "▕": "[", "▏": "]", "●": "*", "…": "~", "▲": "^", "±": "+-", "°": "deg", "Δ": "d", "·": ".", "│": "|", "┤": "+",
    "─": "-", "█": "#", "–": "-", "−": "-", "²": "2", "≥": ">=", "×": "x", "░": ":", "▒": "+", "↑": "^", "↓": "v",
    "√": "sqrt ", "→": "->", "σ": " sigma", "³": "3", "π": "pi", "“": '"', "”": '"',
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Glyphs:
    """One set of signs."""

    name: str  # "braille", "block" or "ascii"
    # columns, rows: dots of a plot in one character cell
    columns: int
    rows: int
    replaced: Mapping[str, str]  # signs that this set lacks and what stands for them

    def text(self, text: str) -> str:
        return text.translate({ord(sign): other for sign, other in self.replaced.items()})


GLYPHS = {
    "braille": Glyphs("braille", 2, 4, {}),
    "block": Glyphs("block", 1, 2, _BLOCK),
    "ascii": Glyphs("ascii", 1, 2, _ASCII),
}


ASKED = "IMUTUI_SCREEN_GLYPHS"  # environment variable of the setting `screen.glyphs`


def choose(environ: Mapping[str, str] = os.environ) -> Glyphs:
    """The set that IMUTUI_SCREEN_GLYPHS names, else what terminal and locale promise.

    The Linux console's fonts have box drawing but no braille; a locale that is not UTF-8 has neither.
    """
    asked = GLYPHS.get(environ.get(ASKED, "").lower())
    if asked is not None:
        return asked
    if environ.get("TERM", "") in ("dumb", "vt100", "vt220"):
        return GLYPHS["ascii"]
    if environ.get("TERM", "") == "linux":
        return GLYPHS["block"]
    locale = environ.get("LC_ALL") or environ.get("LC_CTYPE") or environ.get("LANG") or "utf-8"
    # Textual itself writes UTF-8 whatever the locale is, so "C" alone is no reason to give up braille.
    return GLYPHS["ascii"] if "8859" in locale else GLYPHS["braille"]
