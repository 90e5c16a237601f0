"""Pictures of the screen: SVG files of their own name, beside the recordings."""

import itertools
import time
from pathlib import Path

from imutui.tui import portable_svg


def save(svg: str, folder: Path, page: str) -> Path:
    """Write a picture for any renderer, under a name that no file has yet; where `folder` takes none, here.

    `svg`: the picture as Textual exports it.
    `folder`: where recordings go; made if absent.
    `page`: which page it shows, for its name.
    Raises OSError if neither folder takes a file.
    """
    svg = portable_svg.portable(svg)
    stem = "_".join(part for part in ("imutui", page, time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())) if part)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return _write(svg, folder, stem)
    except OSError:
        return _write(svg, Path.cwd(), stem)


def near(path: Path) -> str:
    """A path as seen from the working folder, if it lies there."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def _write(svg: str, folder: Path, stem: str) -> Path:
    for number in itertools.count(1):
        path = folder / (f"{stem}.svg" if number == 1 else f"{stem}_{number}.svg")
        try:
            with path.open("x", encoding="utf-8") as stream:
                stream.write(svg)
        except FileExistsError:
            continue
        return path
    raise AssertionError
