"""Export of a log's samples as CSV, NPZ or Parquet: complete or absent."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from filters.errors import InputError
from imutui.logbook import atomic_file, parquet, pieces, reader
from imutui.logbook.export import formats, samples
from imutui.logbook.log_stream import MODE
from imutui.logbook.reading import AS_STATED, Reading

__all__ = ["FORMATS", "Exported", "export", "lacks"]

FORMATS = formats.FORMATS


def lacks(kind: str) -> str | None:
    """Return the extra that a format needs and that is not installed, None if all is there."""
    return parquet.EXTRA if kind == "parquet" and not parquet.available() else None


@dataclass(frozen=True, slots=True)
class Exported:
    """What was made."""

    rows: int  # samples
    columns: tuple[str, ...]  # names of the columns
    units: dict[str, str]  # unit of each that has one
    about: dict[str, str]  # what the file states of them
    damage: str  # what is wrong with the log, if anything: all before it was exported
    assumed: tuple[str, ...]  # of another program's log, and what was left out, in words
    reference: Path | None  # file with the log's motion, for `imutui import --reference`


def export(
    log: Path,
    output: Path,
    kind: str,
    reading: Reading = AS_STATED,
    *,
    overwrite: bool = False,
    mode: int = MODE,
    progress: Callable[[int], None] = lambda rows: None,
) -> Exported:
    """Write a log's samples, or the part that a reading states, as `imutui import` reads them.

    `progress`: called with the number of rows written, now and then.
    Raises UnreadableLogError if the log cannot be read.
    Raises InputError if the part has no sample.
    Raises FileExistsError if a file exists and may not be replaced.
    """
    known = pieces.outline(log, reading=reading)
    made = samples.table(known, reading.start, reading.end)
    made = replace(made, about={**made.about, "log_sha256": reader.sha256(log)})
    whole = reading.start is None and reading.end is None
    attached = samples.attached_reference(known) if whole else None
    reference = attached and (output.with_name(f"{output.name}.reference{attached[0]}"), attached[1])
    if reference is not None and reference[0].exists() and not overwrite:
        raise atomic_file.taken(reference[0])
    with atomic_file.part_of(output, overwrite=overwrite, mode=mode) as part:
        rows = formats.write(kind, made, part, progress)
        if not rows:
            raise InputError(f"{log}: --start and --end leave nothing to export.")
    if reference is not None:
        atomic_file.write(reference[0], reference[1], overwrite=overwrite, mode=mode)
    names, assumed = tuple(column.name for column in made.columns), known.log.assumed
    if whole and rows < known.samples:
        assumed = (*assumed, f"samples without a reading are left out: {known.samples - rows:,}")
    return Exported(rows, names, made.units(), made.about, made.damage(), assumed, reference and reference[0])
