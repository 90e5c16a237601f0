"""A picture of the screen as Textual exports it, made to look the same in every renderer of SVG.

The export leans on what only browsers do: it names a font on the web, stretches each run of characters to its length
(`textLength`, unknown to librsvg), and keeps columns apart by spaces, which renderers collapse. Here each word has its
own place, plots and frames are drawn as shapes instead of signs of a font, and the fonts are those that systems have.
"""

import html
import re
from collections.abc import Callable, Iterator

_CELL, _LINE, _BASELINE = 12.2, 24.4, 18.5
"""Of Rich's export: width of a character, height of a line, from the top of a line's background to its baseline."""
_SIZE = "20.3px"  # where the fonts named here are as wide as a cell
_FONTS = '"DejaVu Sans Mono", "Fira Code", "Liberation Mono", Menlo, Consolas, monospace'
_RUN = re.compile(
    r'<text class="(?P<style>[^"]+)" x="(?P<x>[\d.]+)" y="(?P<y>[\d.]+)" textLength="(?P<length>[\d.]+)"[^>]*>'
    r"(?P<text>[^<]*)</text>"
)
_STROKE, _DOT = 1.4, 2.6
_MIDDLE, _CENTRE = _LINE / 2 - _STROKE / 2, _CELL / 2 - _STROKE / 2
_ACROSS, _DOWN = (0.0, _MIDDLE, _CELL, _STROKE), (_CENTRE, 0.0, _STROKE, _LINE)
_SHAPES = {
    "█": [(0.0, 0.0, _CELL, _LINE)],
    "▀": [(0.0, 0.0, _CELL, _LINE / 2)],
    "▄": [(0.0, _LINE / 2, _CELL, _LINE / 2)],
    "▕": [(_CELL - _STROKE, 0.0, _STROKE, _LINE)],
    "▏": [(0.0, 0.0, _STROKE, _LINE)],
    "─": [_ACROSS],
    "│": [_DOWN],
    "┤": [_DOWN, (0.0, _MIDDLE, _CELL / 2, _STROKE)],
    "┊": [(_CENTRE, _LINE * k / 4 + 1.0, _STROKE, _LINE / 8) for k in range(4)],
}
"""Rectangles of a sign, x, y, width and height from the upper left corner of its cell."""
_FIRST_BRAILLE, _LAST_BRAILLE = 0x2800, 0x28FF
# of each bit of a braille sign: column and row of its dot
_DOTS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))


def portable(svg: str) -> str:
    """The same picture for any renderer.

    `svg`: as Textual exports it.
    """
    svg = re.sub(r"\s*@font-face \{.*?\n    \}", "", svg, flags=re.DOTALL)
    svg = svg.replace("font-family: Fira Code, monospace", f"font-family: {_FONTS}")
    svg = svg.replace("font-size: 20px", f"font-size: {_SIZE}").replace("family: arial", "family: Arial, sans-serif")
    underlined = frozenset(re.findall(r"\.([\w-]+) \{[^}]*text-decoration: underline[^}]*\}", svg))
    svg = svg.replace("text-decoration: underline;", "")
    svg = re.sub(r'<clipPath id="[^"]*-line-\d+">.*?</clipPath>\s*', "", svg, flags=re.DOTALL)
    return _RUN.sub(_placed(underlined), svg)


def _placed(underlined: frozenset[str]) -> "Callable[[re.Match[str]], str]":
    def replaced(run: "re.Match[str]") -> str:
        style, x, y = run["style"], float(run["x"]), float(run["y"])
        text = html.unescape(run["text"]).replace("\N{NO-BREAK SPACE}", " ")
        if abs(len(text) * _CELL - float(run["length"])) > _CELL / 2:  # signs two cells wide
            return run[0]
        made = [_word(style, x + _CELL * word.start(), y, word[0]) for word in re.finditer(r"\S+", _signs(text))]
        path = "".join(_shapes(text, x, y - _BASELINE))
        if style in underlined:
            path += _rectangle(x, y + 3.0, _CELL * len(text), _STROKE)
        if path:
            made.append(f'<path class="{style}" d="{path}"/>')
        return "".join(made)

    return replaced


def _word(style: str, x: float, y: float, word: str) -> str:
    return (
        f'<text class="{style}" x="{_number(x)}" y="{_number(y)}" textLength="{_number(_CELL * len(word))}">'
        f"{html.escape(word)}</text>"
    )


def _is_drawn(sign: str) -> bool:
    return sign in _SHAPES or _FIRST_BRAILLE <= ord(sign) <= _LAST_BRAILLE


def _signs(text: str) -> str:
    """What the font draws; blank where shapes are."""
    return "".join(" " if _is_drawn(sign) else sign for sign in text)


def _shapes(text: str, x: float, top: float) -> Iterator[str]:
    for number, sign in enumerate(text):
        left = x + _CELL * number
        for across, down, width, height in _SHAPES.get(sign, ()):
            yield _rectangle(left + across, top + down, width, height)
        if _FIRST_BRAILLE < ord(sign) <= _LAST_BRAILLE:
            for bit, (column, row) in enumerate(_DOTS):
                if ord(sign) >> bit & 1:
                    across = (column + 0.5) * _CELL / 2 - _DOT / 2
                    yield _rectangle(left + across, top + (row + 0.5) * _LINE / 4 - _DOT / 2, _DOT, _DOT)


def _rectangle(x: float, y: float, width: float, height: float) -> str:
    return f"M{_number(x)} {_number(y)}h{_number(width)}v{_number(height)}h{_number(-width)}z"


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
