"""The log of a recording made elsewhere."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import imutui
from imutui.logbook import log_time, schemas
from imutui.logbook.importing.recording import MOVING, STARTED, Piece, Recording
from imutui.logbook.importing.table import ImportDataError
from imutui.logbook.log_stream import MODE
from imutui.logbook.reference_file import ReferenceFile
from imutui.logbook.session_info import SessionInfo
from imutui.logbook.writer import Encoded, whole_log
from imutui.plain_text import in_line

_S_NS = 1_000_000_000


def write(
    recording: Recording,
    info: SessionInfo,
    output: Path,
    *,
    overwrite: bool,
    reference: ReferenceFile | None = None,
    first_ns: int | None = None,
    progress: Callable[[float], None] = lambda share: None,
    mode: int = MODE,
) -> str:
    """Write a recording as a log.

    `info`: axes, site and reference; the rest is filled in here.
    `overwrite`: replace an existing log.
    `reference`: what is known of the motion, to travel in the log.
    `first_ns`: UTC of the first sample, ns, on the clock of the log that it continues; else the modification time of
      the recording's file.
    `progress`: called with the share that is written.
    `mode`: permissions of the log.

    Returns a warning if stamps cannot hold that time, naming the stamps instead; "" if it was used as it is.
    Raises ImportDataError if the log that it continues ends too late for stamps.
    """
    source = in_line(recording.path.name)
    stamps = recording.stamps if first_ns is None else recording.stamps.replace(STARTED, f"after {info.continues}")
    axes = f"{recording.content_id} {info.mount} {info.accel_sign} {info.gyro_sign} {info.g_unit}"
    own = hashlib.sha256(axes.encode()).hexdigest()[:16]
    info = replace(
        info,
        sampling="imported",
        rate_hz=recording.rate_hz,
        source=source,
        software=f"imutui {imutui.__version__}",
        stamps=stamps,
        clock_s=recording.clock_s,
        log_id=own,
        power_on=info.power_on or own,
    )
    base_ns = recording.path.stat().st_mtime_ns if first_ns is None else first_ns
    elapsed_ns = round(recording.duration_s * 1e9)
    why = log_time.why_fitted(base_ns, elapsed_ns)
    if why and first_ns is not None:
        raise ImportDataError(f"the log that it continues ends too late: {why}. Import it without --continues.")
    start_ns = log_time.fitted_ns(base_ns, elapsed_ns)
    table = _Table(recording, info)
    with whole_log(output, info, f"# imported from {source}\n", overwrite=overwrite, mode=mode) as log:
        if reference is not None:
            log.attach(reference.name, reference.media_type, reference.content, start_ns)
        for piece in recording.pieces():
            stamp_ns = start_ns + np.round(piece.t * 1e9).astype(np.int64)
            log.all_encoded(_messages(piece, stamp_ns, info, table))
            progress(piece.share)
        summary = {"samples": recording.samples, "duration_s": elapsed_ns / 1e9, "source": source}
        log.finish(summary, log_time.now_ns())
    return why and f"{recording.path} was last changed at a time that starts the log's stamps, and {why}"


def _messages(piece: Piece, stamp_ns: np.ndarray, info: SessionInfo, table: "_Table") -> list[Encoded]:
    """Messages of samples in order: of each its reference where it is due, the sample, its temperature."""
    axes = info.axes()
    gyro = axes.gyro_to_body(np.deg2rad(piece.gyro_dps))
    accel = axes.accel_to_body(piece.accel_g * info.g_unit)
    rows = table.rows(stamp_ns)
    degc = piece.temperature_degc
    known = np.flatnonzero(np.isfinite(degc))
    encoded = schemas.encode_temperatures(stamp_ns[known], degc[known]) if known.size else []
    temperatures = dict(zip(known.tolist(), encoded, strict=True))
    out: list[Encoded] = []
    samples = schemas.encode_imus(stamp_ns, gyro, accel, piece.valid)
    for k, (stamp, sample) in enumerate(zip(stamp_ns.tolist(), samples, strict=True)):
        if k in rows:
            out.append((schemas.REFERENCE, rows[k], stamp, stamp))
        out.append((schemas.IMU, sample, stamp, stamp))
        if k in temperatures:
            out.append((schemas.TEMPERATURE, temperatures[k], stamp, stamp))
    return out


class _Table:
    """Table angles (deg) and rates (deg/s) of the samples; new ones are written, and one a second."""

    def __init__(self, recording: Recording, info: SessionInfo) -> None:
        self._known = recording.known if info.reference == "trajectory" else {}
        self._kind = info.reference
        self._at = 0
        self._next_ns: int | None = None
        self._last = np.full(6, np.nan)

    def rows(self, stamp_ns: np.ndarray) -> dict[int, bytes]:
        """Return the messages of the next samples that are due, by position."""
        taken = slice(self._at, self._at + stamp_ns.size)
        count, self._at = stamp_ns.size, taken.stop
        level = 0.0 if self._kind == "level" else np.nan
        still = np.nan if self._kind in MOVING else 0.0
        angles = self._known["ang"][taken] if "ang" in self._known else np.full((count, 3), level)
        rates = self._known["rate"][taken] if "rate" in self._known else np.full((count, 3), still)
        both = np.hstack([angles, rates])
        before = np.vstack([self._last if taken.start else both[0], both[:-1]])
        is_new = (np.nan_to_num(both, nan=-1e9) != np.nan_to_num(before, nan=-1e9)).any(axis=1)
        self._last = both[-1]
        due = set(np.flatnonzero(is_new).tolist())
        for k, stamp in enumerate(stamp_ns.tolist()):
            if self._next_ns is None or stamp >= self._next_ns:
                self._next_ns = stamp + _S_NS
                due.add(k)
        at = np.array(sorted(due), int)
        encoded = schemas.encode_table_references(stamp_ns[at], self._kind, angles[at], rates[at]) if due else []
        return dict(zip(at.tolist(), encoded, strict=True))
