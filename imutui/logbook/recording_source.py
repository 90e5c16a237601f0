"""Recordings as columns of numbers, whatever file they are in: NPZ, NPY, Parquet, tables of text, bags."""

import math
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from filters.errors import InputError
from imutui import outside_file
from imutui.logbook import parquet
from imutui.logbook.foreign_log import Cure
from imutui.logbook.recording_columns import PARTS, REFERENCES, REQUIRED
from imutui.logbook.text_table import ROWS, Progress, TextTable

T = TypeVar("T")

_HEADS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""How the head of an array is read, by the version of its format; later ones are for names of columns."""
LIMIT = 2 * 2**30
"""Most that is held of a recording, bytes: of an NPZ's or a Parquet file's arrays. Two days of everything at 133 Hz."""


class ImportDataError(InputError):
    """The recording cannot be imported as it is; the message says what, where, and what to do next.

    `cures`: flags that take it, added to the command that was given.
    """

    def __init__(self, message: str, cures: Sequence[Cure] = ()) -> None:
        super().__init__(message)
        self.cures = tuple(cures)


def cure(*flags: str) -> Cure:
    """Return flags that are added to the command that was given."""
    return "", flags


# ------------------------------------------------------------------------------------------------------------- sources


class Source(Protocol):
    """Columns of numbers, read anew by each call of `pieces`."""

    notes: list[str]  # what was passed over or assumed, in words; complete after a pass
    states_units: bool  # whether `units` are of the source, not of its kind

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, in order."""

    @property
    def units(self) -> Mapping[str, str]:
        """Units of columns, by name, as the source states them."""

    def pieces(self, wanted: list[int], progress: Progress = ..., /) -> Iterator[list[np.ndarray]]:
        """Yield rows of some columns, by their places."""


class Arrays:
    """A source in memory."""

    states_units = True

    def __init__(self, arrays: Mapping[str, np.ndarray], notes: Sequence[str] = ()) -> None:
        self.names, self.units, self.notes = tuple(arrays), dict[str, str](), list(notes)
        self._columns = list(arrays.values())

    def pieces(self, wanted: list[int], progress: Progress = lambda share: None) -> Iterator[list[np.ndarray]]:
        """Yield rows of some columns, by their places, a bounded number at a time."""
        count = max((self._columns[k].size for k in wanted), default=0)
        for first in range(0, count, ROWS):
            yield [self._columns[k][first : first + ROWS] for k in wanted]
            progress(min(1.0, (first + ROWS) / count))


def is_bag(path: Path) -> bool:
    """Return whether a path is one of a bag, or of an MCAP file."""
    return path.is_dir() or path.name.lower().endswith(_BAGS)


def opened(path: Path, topic: str | None = None) -> Source:
    """Return the columns of a file by its content: NPZ, NPY, Parquet, a bag, or a table of text.

    `topic`: of the samples in a bag, or of the rates and of the forces with a comma between.
    Raises ImportDataError if it is none of them.
    """
    try:
        if (
            path.is_dir()
            or path.suffix.lower() in (".bag", ".db3", ".mcap")
            or path.name.endswith((".mcap.zstd", ".mcap.zst"))
        ):
            from imutui.logbook import bag

            return bag.opened(path, topic)
        with outside_file.opened(path) as stream:
            magic = stream.read(8)
        if magic.startswith(b"PK\x03\x04") or path.suffix.lower() == ".npz":
            return _npz(path)
        if magic.startswith(b"\x93NUMPY"):
            return _npy(path)
        if magic.startswith(b"PAR1"):
            return _of_parquet(path)
        if magic.startswith((b"#ROSBAG", b"\x89MCAP")):
            from imutui.logbook import bag

            return bag.opened(path, topic)
        return TextTable(path)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file, or a bag.") from error
    except ImportDataError:
        raise
    except InputError as error:
        if cures := getattr(error, "cures", ()):
            raise ImportDataError(f"{path}: {error}", cures) from error
        raise ImportDataError(f"{path} cannot be read as a CSV table ({error}). {_FORMATS}") from error


_BAGS = (".bag", ".db3", ".mcap", ".mcap.zstd", ".mcap.zst")
_FORMATS = "Name an NPZ file (numpy.savez with t in s, gyro in deg/s, accel in g), a table of text, or a bag."


def _npz(path: Path) -> Source:
    if not zipfile.is_zipfile(path):
        raise ImportDataError(f"{path} is not an NPZ file, though it is named so. {_FORMATS}")
    try:
        archive = _parsed(lambda: np.load(path, allow_pickle=False))
        with archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python 2 wrote such heads, and they are read
            _check_sizes(archive)
            arrays = {name: _member(archive, name) for name in archive.files}
    except InputError as error:
        raise ImportDataError(
            f"{path} cannot be read as NPZ ({error}). Save it with numpy.savez(t=…, gyro=…, accel=…)."
        ) from error
    return _flat(path, arrays)


def _npy(path: Path) -> Source:
    array = _parsed(lambda: np.load(path, allow_pickle=False))
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        raise ImportDataError(f"{path} holds {array.dtype} of shape {array.shape}, not a table. {_FORMATS}")
    return Arrays({f"#{k + 1}": column for k, column in enumerate(array.T)})


def _of_parquet(path: Path) -> Source:
    if not parquet.available():
        raise ImportDataError(f"{path}: Parquet needs pyarrow, the extra `{parquet.EXTRA}`. Or save it as NPZ or CSV.")
    try:
        found = parquet.read(path, lambda name: True, LIMIT)
    except InputError as error:
        raise ImportDataError(f"{path} cannot be read as Parquet ({error}). Name another file.") from error
    return Arrays({name: column for name, column in found.items() if column.dtype.kind in "fiuM"})


def _flat(path: Path, arrays: dict[str, np.ndarray]) -> Source:
    """Return arrays as columns, vectors by their components."""
    lengths = {name: array.shape[0] for name, array in arrays.items() if array.ndim}
    usual = lengths.get("t", max(lengths.values(), default=0))
    flat, notes = dict[str, np.ndarray](), list[str]()
    for name, array in list(arrays.items()):
        if array.ndim == 2 and array.shape[0] in PARTS and array.shape[1] == usual != array.shape[0]:
            array = arrays[name] = array.T
            notes.append(f"`{name}` has a column a sample, and is turned")
        if array.ndim == 2 and array.shape[1] in PARTS:
            flat |= {f"{name}_{part}": array[:, k] for k, part in enumerate(PARTS[array.shape[1]])}
        else:
            flat[name] = array
    for name in REQUIRED:
        vector = name.partition("_")[0]
        if name not in flat and vector in flat:
            array = arrays[vector]
            raise ImportDataError(f"{path}: `{vector}` has shape {array.shape} of {array.dtype}; it must be (N, 3).")
    for name, width in REFERENCES.items():
        if name in arrays and f"{name}_{PARTS[width][-1]}" not in flat:
            array = arrays[name]
            raise ImportDataError(
                f"{path}: `{name}` has shape {array.shape} of {array.dtype}; it must be (N, {width})."
            )
    _check_lengths(path, {name: array for name, array in arrays.items() if _is_known(name)})
    return Arrays(flat, notes)


def _is_known(name: str) -> bool:
    return name in ("t", "gyro", "accel", "temp", *REFERENCES)


def _parsed(parse: Callable[[], T], where: str = "") -> T:
    """Return what numpy makes of foreign bytes, whose unpacking raises many kinds: InputError for all of them."""
    try:
        return parse()
    except OSError:
        raise
    except Exception as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{where}{why}") from error


def _head(archive: Any, told: zipfile.ZipInfo) -> tuple[tuple[int, ...], Any]:
    """Return shape and type of an array of the archive, as its head has them."""
    with archive.zip.open(told) as stream:
        version = np.lib.format.read_magic(stream)
        shape, _, dtype = _HEADS[version](stream)
    return shape, dtype


def _check_sizes(archive: Any) -> None:
    """Refuse, before anything is unpacked, arrays that would be longer than they say, or than memory should hold."""
    total = 0
    for name in archive.files:
        told = archive.zip.getinfo(f"{name}.npy" if f"{name}.npy" in archive.zip.namelist() else name)
        try:
            shape, dtype = _parsed(partial(_head, archive, told), f"`{name}`: ")
        except InputError:
            if _is_known(name):
                raise
            continue
        size = math.prod(shape) * dtype.itemsize
        if dtype.hasobject:
            if _is_known(name):
                raise InputError(f"`{name}` holds Python's objects, which are not read")
            continue
        if not 0 <= size <= told.file_size:
            raise InputError(f"`{name}` says that its shape is {shape}, which is more than the file holds")
        total += size
    if total > LIMIT:
        raise InputError(f"its arrays take {total:,} bytes; the most is {LIMIT:,}: split the recording")


def _member(archive: Any, name: str) -> np.ndarray:
    """Return an array of the archive; one that is not numbers is only named."""
    try:
        array = _parsed(lambda: np.asarray(archive[name]), f"`{name}`: ")
    except InputError:
        if _is_known(name):
            raise
        return np.empty(0)
    if array.dtype.kind not in "fiuM" and not _is_known(name):
        return np.empty(0)
    if array.dtype.kind not in "fiuM":
        raise InputError(f"`{name}` has shape {array.shape} of {array.dtype}; it must be numbers")
    return array


def _check_lengths(path: Path, arrays: dict[str, np.ndarray]) -> None:
    lengths = {name: len(array) if np.ndim(array) else 0 for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        shortest = min(lengths.values())
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ImportDataError(
            f"{path}: lengths differ ({listed} rows), from row {shortest} on something is missing."
            " Every array needs one row a sample; cut them to the same length."
        )
