"""Logs that are parts of one power-on: which log one continues, and when on that log's clock it begins.

A part's metadata names the log before it by id and SHA-256, the power-on, and the power-on's first known instant, so
that a set of logs can be put in order by what they say. What it leaves out: what carries over from part to part
(`imutui.jobs.power_ons` for a trace; the memory of temperature of a file in a rotation is in `SessionInfo.memory`).
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from filters.errors import InputError
from imutui.logbook import reader
from imutui.logbook.session_info import SessionInfo, parse_signs

_ID = 16
_LONGEST_S = 3.2e8


@dataclass(frozen=True, slots=True)
class Preceding:
    """A log that another one continues."""

    path: Path  # where it lies
    info: SessionInfo
    sha256: str  # of its bytes
    # first_ns, last_ns: its first and last sampling instants, UTC, ns
    first_ns: int
    last_ns: int
    period_ns: int  # of its samples

    @property
    def last_s(self) -> float:
        """Its last sampling instant on its own clock, s."""
        return self.info.clock_s + (self.last_ns - self.first_ns) / 1e9


def log_id(info: SessionInfo, sha256: str) -> str:
    """Id of a log; of another program's log, the beginning of its hash."""
    return info.log_id or sha256[:_ID]


def power_on_id(info: SessionInfo, sha256: str) -> str:
    """Id of the power-on that a log is a part of: that of its first log."""
    return info.power_on or log_id(info, sha256)


class ContentId:
    """The id of the samples of a recording: the same for the same samples, by whatever pieces they come."""

    def __init__(self) -> None:
        self._digests = [hashlib.sha256() for _ in range(3)]

    def add(self, t: np.ndarray, gyro: np.ndarray, accel: np.ndarray) -> None:
        """Take more samples."""
        for digest, array in zip(self._digests, (t, gyro, accel), strict=True):
            digest.update(np.ascontiguousarray(array).tobytes())

    def text(self) -> str:
        """Return the id."""
        return hashlib.sha256(b"".join(digest.digest() for digest in self._digests)).hexdigest()[:_ID]


def preceding(path: Path) -> Preceding:
    """Read the log that another is to continue.

    Raises UnreadableLogError if there is nothing to read in it, or it does not say how the unit is mounted.
    """
    log = reader.read(path)
    if not log.own:
        raise reader.UnreadableLogError(
            f"{path} was not written by imutui, so its sign and mounting are not known, and nothing can continue it."
            " Import its recording with `imutui import`, then continue that."
        )
    stamps = log.samples.stamp_ns
    steps = stamps.size - 1
    period = round(float(stamps[-1] - stamps[0]) / steps) if steps else round(1e9 / log.info.rate_hz)
    return Preceding(path, log.info, reader.sha256(path), int(stamps[0]), int(stamps[-1]), period)


def check_same_unit(before: Preceding, info: SessionInfo) -> None:
    """Refuse what cannot be the same unit, mounted as it was, read in the same units.

    Raises InputError: the message names both values and the cure.
    """
    for what, cure, one, two in _differences(before.info, info):
        raise InputError(
            f"{before.path} has {what} {one}, and this recording is imported with {two}: within one power-on that"
            f" cannot change. {cure}, or leave --continues out if it is another power-on."
        )


def _differences(a: SessionInfo, b: SessionInfo) -> list[tuple[str, str, str, str]]:
    """What differs: its name, how to say the first one's value, both values."""
    found: list[tuple[str, str, str, str]] = []
    if a.accel_sign != b.accel_sign:
        signs = f"{a.accel_sign:+d}", f"{b.accel_sign:+d}"
        found.append(("accelerometer sign", f"Say --accel-sign {signs[0]}", *signs))
    if not np.array_equal(a.axes().mount, b.axes().mount):
        found.append(("mounting", f'Say --mount "{a.mount}"', a.mount, b.mount))
    if not np.array_equal(parse_signs(a.gyro_sign), parse_signs(b.gyro_sign)):
        found.append(("gyro sign", f'Say --gyro-sign "{a.gyro_sign}"', a.gyro_sign, b.gyro_sign))
    if a.g_unit != b.g_unit:
        cure = f"Set g_unit = {a.g_unit!r} under [instrument] in imutui.toml"
        found.append(("g unit", cure, f"{a.g_unit!r} m/s²", f"{b.g_unit!r} m/s²"))
    if a.instrument and b.instrument and a.instrument != b.instrument:
        found.append(("instrument", f'Say --instrument "{a.instrument}"', f'"{a.instrument}"', f'"{b.instrument}"'))
    return found


def continuing(before: Preceding, info: SessionInfo, begins_s: float) -> tuple[SessionInfo, int, str]:
    """Place a recording after the log that it continues.

    `before`: that log.
    `info`: of the recording; what it does not say of the instrument is taken from the log.
    `begins_s`: the recording's own time at its first sample, s.
    Returns with the power-on and the log that it continues.
    Returns UTC of its first sample, ns.
    Returns where it was placed, in words.
    Raises InputError if its time is years after the log's.
    """
    gap = begins_s - before.last_s
    if gap > _LONGEST_S:
        raise InputError(
            f"`t` begins {gap:.3g} s after {before.path} ends, more than ten years: the two do not count on one clock."
            " Subtract what it begins with, so that it is placed right after the log's end."
        )
    if gap > 0.0:
        first_ns = before.first_ns + round((begins_s - before.info.clock_s) * 1e9)
        words = f"it begins {gap:.3f} s after {before.path.name} ends, on that log's clock"
    else:
        first_ns = before.last_ns + before.period_ns
        words = (
            f"its t begins at {begins_s:.3f} s, not after {before.path.name} ends ({before.last_s:.3f} s on that log's"
            " clock): it is placed one period after that log's end"
        )
    known = info.instrument or before.info.instrument
    return (
        replace(continued(info, before.info, before.path, before.sha256, before.first_ns), instrument=known),
        first_ns,
        words,
    )


def continued(info: SessionInfo, before: SessionInfo, path: Path, sha256: str, first_ns: int) -> SessionInfo:
    """Session of the part that follows a log.

    `info`: of the part.
    `before`: of the log that it continues.
    `path`, `sha256`: of that log.
    `first_ns`: UTC of that log's first sample, ns.
    """
    return replace(
        info,
        power_on=power_on_id(before, sha256),
        part=before.part + 1,
        continues=path.name,
        continues_id=log_id(before, sha256),
        continues_sha256=sha256,
        power_on_ns=before.power_on_ns or first_ns,
    )
