"""Numbers and names as text of fixed width, so that digits do not dance. Pure functions."""

import itertools
import math
import re
from collections.abc import Callable, Sequence

from imutui.verdict.rules import BIAS_DECIMALS as BIAS_DECIMALS

StyledText = list[str | tuple[str, str]]
"""Text in parts: plain ones, and ones with a style by its side. Widgets make of it what they draw."""

NOTHING = "–"  # stands for a number that is not known

DECIMALS = {"deg/s": 3, "mg": 3, "degC": 2}
MEAN_DECIMALS = {"deg/s": 4, "mg": 3, "degC": 3}


def number(value: float | None, width: int, decimals: int, *, sign: bool = False) -> str:
    """Fixed decimals, right-aligned; a dash if unknown; never "-0.00"."""
    if value is None or not math.isfinite(value):
        return NOTHING.rjust(width)
    return f"{value:{'+' if sign else ''}z{width}.{decimals}f}"


def fitting(value: float | None, width: int, decimals: int, *, sign: bool = False) -> str:
    """As `number`, with fewer decimals, and at last as a power of ten, where it would not fit."""
    made = NOTHING
    for fewer in range(decimals, -1, -1):
        made = number(value, 0, fewer, sign=sign)
        if len(made) <= width:
            return made.rjust(width)
    return f"{value:.0e}".replace("e+0", "e").replace("e+", "e").rjust(width)


def aligned(value: float | None, width: int, decimals: int, most: int, *, sign: bool = False) -> str:
    """As `number`, with the decimal point where a number of `most` decimals has it."""
    pad = most - decimals
    return number(value, width - pad, decimals, sign=sign) + " " * pad


def plain(value: float | None, digits: int = 4) -> str:
    """Shortest form for running text."""
    return NOTHING if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def unit_name(unit: str) -> str:
    """A unit as the screen writes it, in signs that the font has."""
    return "°C" if unit == "degC" else unit


def clock(seconds: float | None) -> str:
    """A duration as h:mm:ss."""
    if seconds is None or not math.isfinite(seconds):
        return "–:––:––"
    whole = max(int(seconds), 0)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def minutes(seconds: float) -> str:
    """Age in words: "40 s", "3 min", "2 h 05 min"."""
    if seconds < 60:
        return f"{int(seconds)} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min"
    return f"{int(seconds // 3600)} h {int(seconds // 60 % 60):02d} min"


def size(count: float | None) -> str:
    """Bytes with a decimal prefix."""
    if count is None:
        return NOTHING
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.0f} {unit}" if unit != "MB" else f"{count:.1f} MB"
        count /= 1000.0
    return f"{count:.2f} GB"


def utc_time(utc: str | None) -> str:
    """Time of day of an ISO stamp."""
    if not utc:
        return "––:––:––"
    return utc.partition("T")[2].removesuffix("Z")[:8] if "T" in utc else utc[:8]


def shorten(text: str, width: int) -> str:
    """At most `width` characters, the middle left out: both ends of a port name tell devices apart."""
    if len(text) <= width:
        return text
    if width < 4:
        return text[:width]
    head = (width - 1) // 2
    return text[:head] + "…" + text[len(text) - (width - 1 - head) :]


def apart(texts: Sequence[str], width: int) -> list[str]:
    """Texts of at most `width` characters, as `shorten` makes them; different texts stay different.

    Of texts that would read the same the end is left out, or the beginning, or both, so that what differs stays.
    """
    made = {text: shorten(text, width) for text in dict.fromkeys(texts)}
    alike: dict[str, list[str]] = {}
    for text, short in made.items():
        alike.setdefault(short, []).append(text)
    for group in alike.values():
        if len(group) > 1:
            made |= _apart(group, width, {made[text] for text in made if text not in group})
    return [made[text] for text in texts]


def _apart(group: list[str], width: int, taken: set[str]) -> dict[str, str]:
    """Texts of a group in the first form in which all of them differ, from those that are taken too."""
    differ = next(n for n, signs in enumerate(itertools.zip_longest(*group)) if len(set(signs)) > 1)
    room = max(width - 2, 1)
    forms: list[Callable[[str], str]] = [
        lambda text: f"…{text[len(text) - width + 1 :]}",
        lambda text: clipped(text, width),
        lambda text: f"…{text[differ : differ + room]}…",
    ]
    for form in forms:
        made = {text: form(text) for text in group}
        if len({*made.values()} | taken) == len(group) + len(taken):
            return made
    numbered: dict[str, str] = {}
    for text in group:
        several = (f"{text[: width - len(str(n)) - 1]}~{n}" for n in itertools.count(1))
        numbered[text] = next(form for form in several if form not in taken and form not in numbered.values())
    return numbered


def shorten_path(path: str, width: int) -> str:
    """At most `width` characters, folders left out in the middle: the file's name is whole as long as it fits."""
    if len(path) <= width:
        return path
    folder, separator, name = path.rpartition("/")
    room = width - len(name) - len("…/")
    if not separator:
        return shorten(path, width)
    if room < 0:
        return shorten(name, width)
    kept = ""
    for part in folder.split("/"):
        if len(kept) + len(part) + 1 > room:
            break
        kept += f"{part}/"
    return f"{kept}…/{name}"


def folded(text: str, width: int, indent: str = "") -> str:
    """Lines of at most `width` characters where a word is longer than that: a path is broken behind a separator.

    Lines without such a word stay as they are, for whoever shows them to wrap; what a longer line goes on with stands
    behind `indent`.
    """
    return "\n".join(made for line in text.split("\n") for made in _folded(line, width, indent))


def _folded(line: str, width: int, indent: str) -> list[str]:
    room = width - len(indent)
    if all(len(word) <= room for word in line.split(" ")):
        return [line]
    made = [""]
    for number, word in enumerate(line.split(" ")):
        parts = [word] if len(word) <= room else re.findall(r"[^/]*/|[^/]+", word)
        for part in parts:
            gap = " " if part is parts[0] and number else ""
            if len(made[-1]) + len(gap) + len(part) <= width or not made[-1].strip():
                made[-1] += gap + part
            else:
                made.append(indent + part)
    return made


def clipped(text: str, width: int) -> str:
    """At most `width` characters, the end left out."""
    return text if len(text) <= width else text[: width - 1] + "…"


def port_name(port: str | None, width: int = 40) -> str:
    """Port without the folders that say nothing."""
    if not port:
        return NOTHING
    for folder in ("/dev/serial/by-id/", "/dev/serial/by-path/", "/dev/"):
        port = port.removeprefix(folder)
    return shorten(port, width)


def profile_name(file: str) -> str:
    """A profile's file without its ending."""
    return file.removesuffix(".toml").removesuffix(".csv")


def plural(count: int, noun: str) -> str:
    """A count with its noun, in the plural where it must be."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
