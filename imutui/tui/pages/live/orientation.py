"""Which way the unit lies, from gravity: its axes drawn, and roll and pitch in numbers."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from textual.content import Content

from imutui.tui.connection.model import View
from imutui.tui.terminal.glyphs import Glyphs
from imutui.tui.widgets import raster
from imutui.tui.widgets.text_lines import TextLines

Floats = npt.NDArray[np.floating]

_ONE_G_MG, _STILL_MG = 1000.0, 50.0
_AXES = ("x", "y", "z")
_DRAWING_CELLS = 36
_LENGTH = 0.8
# where north, east and down point on the screen (right, up), seen from behind, from the right and from above
_SEEN = np.array([[0.45, 0.45], [0.9, -0.2], [0.0, -0.9]])


@dataclass(frozen=True, slots=True)
class Tilt:
    """Attitude as far as gravity shows it."""

    magnitude_mg: float  # of the mean specific force
    # roll_deg, pitch_deg: of the yaw-pitch-roll reading
    roll_deg: float
    pitch_deg: float
    down: str  # axis next to the vertical, with its sign: "+z"
    off_deg: float  # angle between it and the vertical

    @property
    def is_still(self) -> bool:
        return abs(self.magnitude_mg - _ONE_G_MG) < _STILL_MG


def tilt(down_mg: Floats) -> Tilt | None:
    """From the mean specific force, turned so that it points down; None without any.

    `down_mg`: mg, in the instrument's axes.
    """
    magnitude = float(np.linalg.norm(down_mg))
    if magnitude == 0.0:
        return None
    x, y, z = (down_mg / magnitude).tolist()
    axis = int(np.argmax(np.abs(down_mg)))
    off = math.degrees(math.acos(min(abs((x, y, z)[axis]), 1.0)))
    sign = "+" if (x, y, z)[axis] > 0 else "-"
    roll, pitch = math.degrees(math.atan2(y, z)), -math.degrees(math.asin(x))
    return Tilt(magnitude, roll, pitch, sign + _AXES[axis], off)


def axes_in_space(seen: Tilt) -> Floats:
    """The three axes in north, east and down, of a unit that points north: (3, 3), a row each."""
    roll, pitch = math.radians(seen.roll_deg), math.radians(seen.pitch_deg)
    about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
    axes: Floats = (about_y @ about_x).T
    return axes


def drawn(seen: Tilt, rows: int, cells: int, glyphs: Glyphs) -> list[str]:
    """The axes as lines from the middle, with their names at the ends."""
    height, width = rows * glyphs.rows, cells * glyphs.columns
    half = _LENGTH * height / 2
    bits = np.zeros((height, width), bool)
    # a character is about twice as high as it is wide
    across = 2.0 * glyphs.columns / glyphs.rows
    ends = axes_in_space(seen) @ _SEEN
    names = {}
    for name, (right, up) in zip(_AXES, ends, strict=True):
        steps = np.linspace(0.0, 1.0, 4 * height)
        columns = np.rint(width / 2 + steps * right * half * across).astype(int)
        lines = np.rint(height / 2 - steps * up * half).astype(int)
        inside = (columns >= 0) & (columns < width) & (lines >= 0) & (lines < height)
        bits[lines[inside], columns[inside]] = True
        row = round((height / 2 - 1.2 * up * half) / glyphs.rows - 0.5)
        names[min(max(row, 0), rows - 1), int((width / 2 + 1.2 * right * half * across) // glyphs.columns)] = name
    lines_of_signs = [list(line) for line in raster.cells(bits, glyphs)]
    for (row, cell), name in names.items():
        lines_of_signs[row][min(max(cell, 0), cells - 1)] = name
    return ["".join(line) for line in lines_of_signs]


class Orientation(TextLines):
    """How the unit lies, of the means of the last seconds."""

    DEFAULT_CSS = "Orientation { height: 1fr; }"

    def lines(self, view: View, width: int) -> list[Content]:
        head = self.rule("orientation of the unit, from gravity", width)
        means = {row["name"]: row["mean"] for row in view.shown["channels"]} if view.shown is not None else {}
        seen = tilt(np.array([means[name] for name in ("ax", "ay", "az")])) if means else None
        rows = max(self.content_size.height - 1, 4)
        if seen is None:
            return [head, *[self.line("")] * (rows - 1)]
        signs = drawn(seen, rows, _DRAWING_CELLS, self.glyphs)
        words = [*_in_words(seen), *[""] * rows]
        return [head, *(self.line(line, "  ", word) for line, word in zip(signs, words, strict=False))]


def _in_words(seen: Tilt) -> list[str]:
    """What gravity says, line by line; while the unit moves it says nothing of the attitude."""
    force = f"specific force {seen.magnitude_mg:.1f} mg"
    if not seen.is_still:
        return ["moving", f"{force}, not gravity alone:", "no attitude can be told from it"]
    return [
        f"down is {seen.down}, within {seen.off_deg:.2f}°",
        f"roll  {seen.roll_deg:+8.2f}°",
        f"pitch {seen.pitch_deg:+8.2f}°",
        "yaw is not seen: north is drawn",
        force,
    ]
