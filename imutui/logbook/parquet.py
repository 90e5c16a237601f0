"""Tables in Parquet files: the only user of pyarrow, which is an extra.

Written in batches of rows, so that a table of any length takes the memory of one of them.
"""

import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from filters.errors import InputError

Kind = Literal["double", "int64", "uint64", "bool", "string"]

EXTRA = "parquet"  # what brings pyarrow, and nothing else


class Column(NamedTuple):
    """A column: its name, what its cells are, and their unit where they have one."""

    name: str
    kind: Kind
    unit: str = ""


def available() -> bool:
    """Whether pyarrow is installed; loads nothing."""
    return importlib.util.find_spec("pyarrow") is not None


def write(
    path: Path,
    columns: Sequence[Column],
    batches: Iterable[Mapping[str, Sequence[object] | np.ndarray]],
    notes: Mapping[str, str],
) -> None:
    """Write a table.

    `path`: file to write; one that is there is replaced.
    `columns`: in the order in which they are to stand. A unit is kept as the column's metadata, `unit`.
    `batches`: cells by the name of their column, as many in each; None is an empty cell.
    `notes`: metadata of the table.
    Raises OSError if the disk does not take it.
    """
    import pyarrow as pa
    from pyarrow import parquet

    types = {"double": pa.float64(), "int64": pa.int64(), "uint64": pa.uint64()}
    types |= {"bool": pa.bool_(), "string": pa.string()}
    schema = pa.schema(
        [
            pa.field(column.name, types[column.kind], metadata={"unit": column.unit} if column.unit else None)
            for column in columns
        ],
        metadata=dict(notes),
    )
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for batch in batches:
            arrays = [pa.array(batch[field.name], field.type) for field in schema]
            writer.write_batch(pa.record_batch(arrays, schema=schema))


def read(path: Path, wanted: Callable[[str], bool], limit: int) -> dict[str, np.ndarray]:
    """Columns by name, those that are wanted; of the others the name alone.

    `wanted`: whether a column of this name is.
    `limit`: most bytes that the columns may take.
    Raises InputError if it is no Parquet file, or larger.
    Raises OSError if it cannot be read.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path) as file:
            names = [name for name in file.schema_arrow.names if wanted(name)]
            if file.metadata.num_rows * len(names) * 8 > limit:
                raise InputError(f"its columns take more than {limit:,} bytes: split the recording")
            columns = file.read(columns=names)
            known = {name: columns[name].to_numpy() for name in names}
            return dict.fromkeys(file.schema_arrow.names, np.empty(0)) | known
    except pa.ArrowException as error:
        raise InputError(str(error).splitlines()[0]) from error
