"""What is in a log: in a millisecond for a list of them (`brief`), or all of it (`info`)."""

from dataclasses import dataclass
from pathlib import Path

from imutui.logbook import summary
from imutui.logbook.session import MEASURED, SIMULATED, UNKNOWN

SUFFIX = ".mcap"


@dataclass(frozen=True, slots=True)
class Brief:
    """A log as a list shows it; None and "" where the file does not say.

    Attributes
    ----------
    path : Path
        The file.
    bytes : int
        Its size.
    modified : float
        When it was last written to, Unix time, s.
    state : str
        "finished", "unfinished", "damaged", "being written" or "not a log".
    why : str
        What is behind a state other than finished, or that a finished file has no samples.
    started : float or None
        When the recording began, Unix time, s.
    seconds : float or None
        Time from its first to its last sample (to its last message, if nobody counted).
    samples : int or None
        Output samples.
    rate_hz : float or None
        Rate that was asked for; of another program's file the measured one.
    measured_hz : float or None
        Samples over time.
    kind : str
        "measured", "simulated" or "unknown".
    by_ends : bool
        Whether samples and seconds come from the file's first and last chunk, since there is no summary.
    instrument, serial_number, operator, place, table, note, reference, filter : str
        From the session.
    converged : bool or None
        Of the filter that ran when it was recorded.
    lost_packets : int or None
        As counted when it was recorded.
    """

    path: Path
    bytes: int
    modified: float
    state: str
    why: str = ""
    started: float | None = None
    seconds: float | None = None
    samples: int | None = None
    rate_hz: float | None = None
    measured_hz: float | None = None
    kind: str = UNKNOWN
    by_ends: bool = False
    instrument: str = ""
    serial_number: str = ""
    operator: str = ""
    place: str = ""
    table: str = ""
    note: str = ""
    reference: str = ""
    filter: str = ""
    converged: bool | None = None
    lost_packets: int | None = None

    @property
    def name(self) -> str:
        """File name."""
        return self.path.name


_TEXTS = ("instrument", "serial_number", "operator", "place", "table", "note", "reference", "filter")


def brief(path: Path) -> Brief:
    """A log as a list shows it, from its first and last few kilobytes.

    Parameters
    ----------
    path : Path
        Any file: one that cannot be opened, or is no log, is told as such.
    """
    try:
        found = summary.read(path)
    except OSError as error:
        return Brief(path, 0, 0.0, summary.NO_LOG, f"it cannot be opened: {error.strerror or error}")
    span, samples, session = found.seconds, found.samples, found.session
    measured = (samples - 1) / span if samples and samples > 1 and span else None
    kind = session.get("kind", UNKNOWN)
    converged, lost = found.result.get("converged"), found.result.get("lost_packets")
    return Brief(
        path,
        found.bytes,
        found.modified,
        found.state,
        found.why,
        None if found.started_ns is None else found.started_ns / 1e9,
        span,
        samples,
        _number(session.get("rate_hz")) if session else measured,
        measured,
        kind if kind in (MEASURED, SIMULATED) else UNKNOWN,
        found.by_ends,
        **{name: session.get(name, "") for name in _TEXTS},
        converged=converged if isinstance(converged, bool) else None,
        lost_packets=lost if isinstance(lost, int) else None,
    )


def recordings(folder: Path) -> list[Brief]:
    """Logs of a folder (not of folders in it), the one written to last first; empty if there is no such folder."""
    try:
        paths = [path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file()]
    except OSError:
        return []
    return sorted((brief(path) for path in paths), key=lambda b: (-b.modified, b.path.name))


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        return None
