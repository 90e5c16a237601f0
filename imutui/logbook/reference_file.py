"""A reference that travels in a log, or lies in a file beside it, as the motion that the filter takes."""

import csv
import tomllib
from dataclasses import dataclass

import numpy as np

from filters.motion import profile
from filters.motion.profile import Profile
from filters.motion.reference import Trajectory
from imutui.logbook import trajectory_file

ATTACHMENTS = ("reference.toml", "reference.csv")
"""Names under which a reference travels."""
PROFILE_COLUMNS = ("t", "outer", "middle", "inner")


@dataclass(frozen=True, slots=True)
class ReferenceFile:
    """A reference as it travels in a log.

    Attributes
    ----------
    kind : str
        "trajectory" or "profile".
    name, media_type : str
        Of the attachment: reference.csv or reference.toml.
    content : bytes
        As the file has it.
    """

    kind: str
    name: str
    media_type: str
    content: bytes

    def motion(self) -> Profile | Trajectory:
        """What it says; raises ValueError if that cannot be."""
        return parse(self.name, self.content)


def parse(name: str, content: bytes) -> Profile | Trajectory:
    """Motion of a file's content: a profile (TOML, or CSV of table angles) or a trajectory (CSV).

    Parameters
    ----------
    name : str
        Of the file, for its suffix and for messages.
    content : bytes
        UTF-8 text.

    Raises
    ------
    ValueError
        If it is neither; the message names file, line or key.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{name} is not a text file ({error})") from error
    if name.lower().endswith(".toml"):
        try:
            return profile.from_document(tomllib.loads(text))
        except ValueError as error:
            raise ValueError(f"{name} is no table profile: {error}") from error
    first = next(csv.reader([text.partition("\n")[0]]), [])
    if tuple(cell.strip() for cell in first) == PROFILE_COLUMNS:
        return parse_angles(text, name)
    return trajectory_file.parse(text, name)


def parse_angles(text: str, name: str) -> Profile:
    """Profile of a CSV text `t, outer, middle, inner` (s, deg).

    Raises
    ------
    ValueError
        If a row does not read as four numbers, or time does not increase; the message names the row.
    """
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(c.strip() for c in row)]
    except csv.Error as error:
        raise ValueError(f"{name} is not a CSV file: {error}") from error
    if not rows or tuple(rows[0]) != PROFILE_COLUMNS:
        found = ", ".join(rows[0]) if rows else "nothing"
        raise ValueError(f'{name} begins with "{found}"; its heading is {", ".join(PROFILE_COLUMNS)} (s, deg).')
    values = np.empty((len(rows) - 1, 4))
    for n, row in enumerate(rows[1:]):
        try:
            values[n] = [float(cell) for cell in row]
        except ValueError as error:
            raise ValueError(f'{name}, row {n + 2}: "{", ".join(row)}" is not four numbers') from error
    t, outer, middle, inner = values.T
    try:
        return profile.from_samples(t, np.deg2rad(outer), np.deg2rad(middle), np.deg2rad(inner))
    except ValueError as error:
        raise ValueError(f"{name}: {error} (rows counted from 0, after the heading)") from error
