"""What a recording's own arrays or a file beside it say of the motion, as the attachment that travels in the log."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from filters import attitude
from filters.errors import InputError
from filters.motion.kinematics import attitudes
from filters.motion.profile import Profile
from filters.motion.reference import KINDS, Trajectory
from filters.state import Site
from filters.types import Array
from imutui import outside_file
from imutui.logbook import reference_file, trajectory_file
from imutui.logbook.importing.table import ImportDataError
from imutui.logbook.reference_file import ReferenceFile

# east-north-up to north-east-down
_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_NORM_SLACK = 0.1


def from_file(path: Path) -> ReferenceFile:
    """Reference from a file that --reference names: a trajectory (CSV) or a table's profile (TOML, or CSV of angles).

    Raises ImportDataError if it cannot be read, or is neither.
    """
    try:
        content = _content(path)
        motion = reference_file.parse(str(path), content)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. --reference names a CSV or TOML file.") from error
    except InputError as error:
        raise ImportDataError(str(error)) from error
    kind = "profile" if isinstance(motion, Profile) else "trajectory"
    if path.suffix.lower() == ".toml":
        return ReferenceFile(kind, "reference.toml", "application/toml", content)
    return ReferenceFile(kind, "reference.csv", "text/csv", content)


def from_text(text: str) -> ReferenceFile | None:
    """Reference from what --reference says: a file, or the name of a ready-made profile; None for a word of its own.

    Raises ImportDataError if the file cannot be used.
    Raises InputError if it is none of them; the message lists the names.
    """
    path = Path(text)
    if path.suffix.lower() in (".csv", ".toml"):
        return from_file(path)
    named = None if text in KINDS else reference_file.find(text)
    if named is not None:
        return ReferenceFile("profile", "reference.toml", "application/toml", named.text.encode())
    if text not in KINDS:
        raise InputError(
            f'--reference is "{text}": no word for a reference (level, gravity, turned), no .toml or .csv file, and no'
            f" ready-made profile. Those are {reference_file.listed()}."
        )
    return None


def name_of(text: str) -> str:
    """Name of the file that `from_text` takes; that which a ready-made profile would have."""
    path = Path(text)
    named = None if path.suffix.lower() in (".csv", ".toml") else reference_file.find(text)
    return path.name if named is None else named.file


def _content(path: Path) -> bytes:
    try:
        return outside_file.read(path, outside_file.TEXT_LIMIT)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def from_arrays(t: Array, known: Mapping[str, Array], mount: Array, site: Site | None = None) -> ReferenceFile | None:
    """Trajectory from the arrays of a recording.

    `t`: s, shape (N,).
    `known`: `ang`, `ref_quat`, `gps_pos`, `gps_vel_ned` as docs/formats.md has them, NaN where unknown.
    `mount`: M from instrument to body axes, shape (3, 3).
    `site`: where a table stands: with its angles, and no receiver, position and velocity are known too.
    Returns none if nothing is known anywhere.
    Raises ImportDataError if a row can't be; the message names array and row.
    """
    values = np.full((t.size, 9), np.nan)
    if "gps_pos" in known or "gps_vel_ned" in known:
        values[:, :6] = _fixes(known, t.size)
    if "ang" in known:
        values[:, 6:] = attitude.to_rpy(attitudes(np.deg2rad(known["ang"])))
        if site is not None and np.isnan(values[:, :6]).all():
            told = np.isfinite(values[:, 6:]).all(axis=1)
            values[told, :6] = site.latitude, site.longitude, site.height, 0.0, 0.0, 0.0
    elif "ref_quat" in known:
        values[:, 6:] = attitude.to_rpy(body_attitude(known["ref_quat"], mount))
    rows = np.isfinite(values).any(axis=1)
    if not rows.any():
        return None
    text = trajectory_file.format(Trajectory(t[rows] - t[0], values[rows]))
    return ReferenceFile("trajectory", "reference.csv", "text/csv", text.encode())


def body_attitude(ref_quat: Array, mount: Array) -> Array:
    """C_nb of quaternions w, x, y, z from instrument to east-north-up, shape (N, 4); NaN where unknown.

    Raises ImportDataError if one is far from unit length, or the mounting mirrors.
    """
    if np.linalg.det(mount) < 0.0:
        raise ImportDataError(
            "`ref_quat` can't be used with a left-handed --mount: no rotation leads from mirrored instrument axes to"
            " east-north-up. Name a right-handed mounting and mend the rates with --gyro-sign, or leave `ref_quat` out."
        )
    norm = np.linalg.norm(ref_quat, axis=1)
    # zeros are how some programs say "unknown"
    norm = np.where(norm == 0.0, np.nan, norm)
    bad = np.abs(norm - 1.0) > _NORM_SLACK
    if bad.any():
        k = int(np.argmax(bad))
        raise ImportDataError(
            f"`ref_quat` has length {norm[k]:.3g} in row {k} of the part taken (first is 0); a rotation's is 1."
            " Write NaN where attitude is unknown."
        )
    w, x, y, z = (ref_quat / norm[:, None]).T
    C = np.empty((norm.size, 3, 3))
    C[:, 0] = np.stack([w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1)
    C[:, 1] = np.stack([2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)], axis=1)
    C[:, 2] = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], axis=1)
    return np.asarray(_NED @ C @ mount.T)


def _fixes(known: Mapping[str, Array], n: int) -> Array:
    """Position (rad, rad, m) and velocity (m/s) where a receiver has a new fix, shape (N, 6), else NaN.

    A receiver's last fix stands in every row until the next: what stood there from the first row on is of unknown age
    and is taken only if nothing else ever comes.
    """
    unknown = np.full((n, 3), np.nan)
    position, velocity = known.get("gps_pos", unknown), known.get("gps_vel_ned", unknown)
    _check_degrees(position)
    held = np.nan_to_num(np.hstack([position, velocity]), nan=-1e9)
    new = np.r_[False, (np.diff(held, axis=0) != 0.0).any(axis=1)]
    if not new.any():
        new[0] = True
    # a receiver without a fix writes zeros
    new &= ~(position == 0.0).all(axis=1)
    out = np.hstack([position * [np.pi / 180.0, np.pi / 180.0, 1.0], velocity])
    for group in (slice(0, 3), slice(3, 6)):
        out[~np.isfinite(out[:, group]).all(axis=1), group] = np.nan
    out[~new] = np.nan
    return out


def _check_degrees(position: Array) -> None:
    for axis, (what, low, high) in enumerate((("latitude", -90.0, 90.0), ("longitude", -180.0, 360.0))):
        bad = (position[:, axis] < low) | (position[:, axis] > high)
        if bad.any():
            k = int(np.argmax(bad))
            raise ImportDataError(
                f"`gps_pos` has {what} {position[k, axis]:g} in row {k} of the part taken (first is 0), outside {low:g}"
                f" to {high:g} degrees. It must be degrees, degrees, metres."
            )
