"""Pictures of the screen look the same in a renderer that knows less than a browser: librsvg."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text

from imutui.tui import pictures
from imutui.tui.portable_svg import portable

CELL, LINE, LEFT, TOP = 12.2, 24.4, 9.0, 41.0
SCREEN = (
    "  x gyro      0.3461 ±0.0291   deg/s    ",
    "    0.40 ┤⣀⣀⣀⣀      ██▀▀▄▄        ⣿⣿   W",
    "─> x gyro ──────────────────────────────",
)


def exported() -> str:
    """A screen of three lines, as it is exported; the first one underlined."""
    console = Console(width=40, record=True, force_terminal=True, file=open("/dev/null", "w"))  # noqa: SIM115
    for number, line in enumerate(SCREEN):
        console.print(Text(line, "bold underline" if number == 0 else "on blue" if number == 1 else ""))
    return console.export_svg(title="imutui")


def test_no_renderer_has_to_stretch_collapse_or_fetch_anything() -> None:
    """No font from the web, no run of spaces, each word at its column, every sign of a plot a shape."""
    svg = portable(exported())
    assert "url(http" not in svg
    assert "@font-face" not in svg
    assert "text-decoration" not in svg
    words = re.findall(r'<text class="[^"]+" x="([\d.]+)" y="[\d.]+" textLength="[\d.]+">([^<]*)</text>', svg)
    expected = [
        (word.start(), word[0]) for line in SCREEN for word in re.finditer(r"\S+", re.sub("[─┤█▀▄⣀⣿]", " ", line))
    ]
    found = [(round(float(x) / CELL), word.replace("&gt;", ">")) for x, word in words]
    assert found == expected
    assert not re.search("[─┤█▀▄⣀⣿\N{NO-BREAK SPACE}]|&#160;", svg)


def test_librsvg_draws_each_word_and_dot_in_its_column(tmp_path: Path) -> None:
    """Ink of every character lies in the cell where the terminal had it; blank cells stay blank."""
    if shutil.which("rsvg-convert") is None:
        pytest.skip("rsvg-convert is not installed: apt-get install librsvg2-bin")
    image = pytest.importorskip("matplotlib.image", reason="reads the picture: pip install '.[report]'")
    path = pictures.save(exported(), tmp_path, "live")
    subprocess.run(["rsvg-convert", path, "-o", tmp_path / "live.png"], check=True, timeout=60)
    pixels = image.imread(tmp_path / "live.png")[..., :3]
    for row, line in enumerate(SCREEN):
        for column, sign in enumerate(line[:39]):  # beyond the last one is the frame
            x, y = LEFT + CELL * column, TOP + LINE * row + 1.5
            # without the underline, and what antialiasing spills over an edge
            cell = pixels[
                round(y + 2) : round(y + LINE - (8 if row == 0 else 2)), round(x + 1.5) : round(x + CELL - 1.5)
            ]
            spread = float(np.ptp(cell.reshape(-1, 3), axis=0).max())
            full = sign == "█" and spread < 0.05 and cell.mean() > 0.5
            assert full or (spread > 0.2) == (sign not in " █"), (row, column, sign, spread)
