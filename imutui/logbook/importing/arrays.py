"""NPZ, NPY and Parquet files as columns; nothing is unpacked that is larger than it says."""

import json
import math
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from filters.errors import InputError
from imutui import outside_file
from imutui.logbook import parquet
from imutui.logbook.importing import columns
from imutui.logbook.importing.table import Column, ImportDataError, Rows, Table

T = TypeVar("T")

LIMIT = 2 * 2**30
"""Most bytes that the arrays of one file may take: they are held in memory. Two days of everything at 133 Hz."""
_HEADS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""Readers of an array's head by the version of its format; later versions are for names of fields."""
_PIECE = 2**16
_WIDTHS = {"gyro": 3, "accel": 3, "t": 1, "temp": 1} | columns.REFERENCES


@dataclass(frozen=True, slots=True)
class _Array:
    """An array of a file before it is read."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    load: Callable[[], np.ndarray]


def read_npz(path: Path) -> Table:
    """Return the arrays of an NPZ file as columns, a vector's components each.

    Raises ImportDataError if it cannot be read, or arrays of samples differ in length.
    """
    try:
        outside_file.opened(path).close()  # a pipe would be waited for
        archive = _parsed(lambda: np.load(path, allow_pickle=False))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python 2 wrote such heads, and they are read
            found = {name: _member(archive, name) for name in archive.files}
            units = _units(found)
            return _table(path, found, units)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ or CSV file.") from error
    except ImportDataError:
        raise
    except InputError as error:
        raise ImportDataError(
            f"{path} cannot be read as NPZ ({error}). Save it with numpy.savez(t=…, gyro=…, accel=…), or as CSV."
        ) from error


def read_npy(path: Path) -> Table:
    """Return the columns of a single array, of shape (N, k) or (k, N); raises as `read_npz`."""
    try:
        array = _parsed(lambda: np.load(path, allow_pickle=False, mmap_mode="r"))
    except InputError as error:
        raise ImportDataError(
            f"{path} cannot be read as NPY ({error}). Save it with numpy.save or numpy.savez."
        ) from error
    if array.dtype.names:
        return _table(path, {name: _held(array[name]) for name in array.dtype.names}, {})
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        raise ImportDataError(f"{path} holds {array.dtype} of shape {array.shape}; rows of numbers are needed, (N, 7).")
    array = array.T if array.shape[0] < array.shape[1] else array
    return _table(path, {"": _held(array)}, {})


def read_parquet(path: Path) -> Table:
    """Return the columns of a Parquet file; raises as `read_npz`."""
    if not parquet.available():
        raise ImportDataError(f"{path}: Parquet needs pyarrow, the extra `{parquet.EXTRA}`. Or save it as NPZ or CSV.")
    try:
        found = parquet.read(path, lambda name: True, LIMIT)
    except OSError as error:
        raise ImportDataError(f"{path}: {error.strerror or error}. Name an NPZ, CSV or Parquet file.") from error
    except InputError as error:
        raise ImportDataError(f"{path} cannot be read as Parquet ({error}). Name another file.") from error
    return _table(path, {name: _held(array) for name, array in found.items()}, {})


def _held(array: np.ndarray) -> _Array:
    return _Array(array.shape, array.dtype, lambda: array)


def _flat(array: _Array) -> _Array:
    """Return an array of one row or one column, as MATLAB has vectors, without that axis."""
    if len(array.shape) != 2 or min(array.shape) != 1 or max(array.shape) <= 4:
        return array
    return _Array((max(array.shape),), array.dtype, lambda: array.load().ravel())


def _parsed(parse: Callable[[], T], where: str = "") -> T:
    """Return what numpy makes of foreign bytes; InputError for the many kinds of error that its parsing raises."""
    try:
        return parse()
    except OSError:
        raise
    except Exception as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{where}{why}") from error


def _member(archive: Any, name: str) -> _Array:
    """An array of an archive by its head; one that cannot be read is empty, and raises when it is needed."""
    told = archive.zip.getinfo(f"{name}.npy" if f"{name}.npy" in archive.zip.namelist() else name)
    load = partial(_loaded, archive, name, told)
    try:
        shape, dtype = _parsed(partial(_head, archive, told), f"`{name}`: ")
    except InputError:
        if name in _WIDTHS:
            raise
        return _Array((0,), np.dtype("U1"), load)
    if name in _WIDTHS:
        _check_size(name, shape, dtype, told)
    return _Array(shape, dtype, load)


def _head(archive: Any, told: zipfile.ZipInfo) -> tuple[tuple[int, ...], np.dtype[Any]]:
    with archive.zip.open(told) as stream:
        version = np.lib.format.read_magic(stream)
        shape, _, dtype = _HEADS[version](stream)
    return shape, dtype


def _check_size(name: str, shape: tuple[int, ...], dtype: np.dtype[Any], told: zipfile.ZipInfo) -> int:
    size = math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise InputError(f"`{name}` holds Python's objects, which are not read")
    if not 0 <= size <= told.file_size:
        raise InputError(f"`{name}` says that its shape is {shape}, which is more than the file holds")
    return size


def _loaded(archive: Any, name: str, told: zipfile.ZipInfo) -> np.ndarray:
    def load() -> np.ndarray:
        shape, dtype = _head(archive, told)
        _check_size(name, shape, dtype, told)
        return np.asarray(archive[name])

    return _parsed(load, f"`{name}`: ")


def _units(found: Mapping[str, _Array]) -> dict[str, str]:
    """Units that an export states in its text `units`."""
    array = found.get("units")
    if array is None or array.dtype.kind != "U" or array.shape != ():
        return {}
    try:
        text = str(array.load())
    except InputError:
        return {}
    try:
        units = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return {str(k): columns.stated_unit(str(v)) for k, v in units.items()} if isinstance(units, dict) else {}


def _table(path: Path, found: Mapping[str, _Array], units: Mapping[str, str]) -> Table:
    """Columns of arrays. Those of samples have as many rows as the array of time, or as most of them."""
    found = {name: _flat(array) for name, array in found.items()}
    known = {name: array for name, array in found.items() if _kind(name) and array.shape}
    for name in [name for name in known if name in _WIDTHS]:
        _check_shape(path, name, known[name])
    lengths = {name: _length(array, name) for name, array in known.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise ImportDataError(
            f"{path}: lengths differ ({listed} rows), from row {min(lengths.values())} on something is missing."
            " Every array needs one row a sample; cut them to the same length."
        )
    rows = next(iter(lengths.values()), max((array.shape[0] for array in found.values() if array.shape), default=0))
    made: list[tuple[Column, str, int]] = []
    table = Table(path, (), lambda chosen: iter(()))
    for name, array in found.items():
        is_wide = len(array.shape) == 2 and array.shape[0] != rows and array.shape[1] == rows
        count = {1: 1, 2: array.shape[0 if is_wide else -1]}.get(len(array.shape), 0) if array.shape else 0
        if rows not in array.shape or count > 64 or array.dtype.kind not in "fiumM" or (not name and count < 2):
            made.append((Column(name), name, -1))
            continue
        if is_wide:
            table.remark(f"`{name}` has a column a sample: it was transposed")
        unit = "ns" if array.dtype.kind in "mM" else units.get(name, "")
        names = [""] * count if not name else columns.parts(name, 1 if len(array.shape) == 1 else count)
        for k, part in enumerate(names):
            base, stated = columns.split_unit(part)
            made.append((Column(base, unit or stated), name, k))

    def pieces(chosen: Sequence[int]) -> Iterator[Rows]:
        try:
            held = {made[k][1]: _columnar(found[made[k][1]], rows) for k in chosen if made[k][2] >= 0}
        except InputError as error:
            raise ImportDataError(f"{path} cannot be read ({error}). Save it anew with numpy.savez.") from error
        unknown = np.full(rows, np.nan)
        if sum(array.nbytes for array in held.values()) > LIMIT:
            raise ImportDataError(f"{path} takes more than {LIMIT:,} bytes: split the recording.")
        for first in range(0, rows, _PIECE):
            part = slice(first, first + _PIECE)
            yield (
                min(1.0, part.stop / rows),
                [held[made[k][1]][part, made[k][2]] if made[k][2] >= 0 else unknown[part] for k in chosen],
            )

    return Table(path, tuple(column for column, _, _ in made), pieces, table.remarks)


def _columnar(array: _Array, rows: int) -> np.ndarray:
    """Values of shape (N, k), numbers; of dates, ns."""
    size = math.prod(array.shape) * array.dtype.itemsize
    if size > LIMIT:
        raise InputError(f"its arrays take {size:,} bytes; the most is {LIMIT:,}: split the recording")
    values = array.load()
    if values.dtype.kind in "mM":
        values = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64)
    elif values.dtype.kind != "i" or values.dtype.itemsize < 8:
        values = values.astype(float)
    values = values[:, None] if values.ndim == 1 else values
    return values if len(values) == rows else values.T


def _kind(name: str) -> bool:
    return name in _WIDTHS or bool(columns.meant(name) or columns.meant(f"{name}_x"))


def _length(array: _Array, name: str) -> int:
    """Rows of an array: a vector may stand in columns, (3, N)."""
    if len(array.shape) == 2 and array.shape[0] in (3, 4) and array.shape[1] not in (3, 4):
        return array.shape[1]
    return array.shape[0]


def _check_shape(path: Path, name: str, array: _Array) -> None:
    width = _WIDTHS[name]
    wanted = "(N,)" if width == 1 else f"(N, {width})"
    fits = len(array.shape) == 1 if width == 1 else len(array.shape) == 2 and width in array.shape
    if array.dtype.kind not in ("fiumM" if name == "t" else "fiu") or not fits:
        raise ImportDataError(
            f"{path}: `{name}` has shape {array.shape} of {array.dtype}; it must be numbers of shape {wanted}."
        )
