"""The numeric columns of a LeRobotDataset's data files, some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from lerobot_spacedock.errors import FileFormatError

BATCH_ROWS = 4096


def iterate_columns(root: Path, names: Sequence[str]) -> Iterator[dict[str, np.ndarray]]:
    """The named columns of a dataset in the order of its files, in batches of rows, each (n, d); nothing else is read.

    Raises:
        FileFormatError: a file that is no Parquet file, or lacks a column.
    """
    for path in sorted((root / "data").glob("chunk-*/file-*.parquet")):
        try:
            with pq.ParquetFile(path) as file:
                missing = [name for name in names if name not in file.schema_arrow.names]
                if missing:
                    raise FileFormatError(f"{path}: columns {missing} are missing.")
                for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=names):
                    yield {name: _array(batch.column(name), name) for name in names}
        except (pa.ArrowException, OSError, ValueError) as error:
            if isinstance(error, FileFormatError):
                raise
            raise FileFormatError(f"{path}: not a readable Parquet file ({error}).") from error


def _array(column: pa.Array, name: str) -> np.ndarray:
    """Scalars or lists of one length as (n, d)."""
    if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
        lengths = pc.list_value_length(column)
        if lengths.null_count or len(lengths.unique()) > 1:
            raise ValueError(f"{name} holds vectors of different lengths, or none")
        return column.flatten().to_numpy(zero_copy_only=False).reshape(len(column), -1)
    return column.to_numpy(zero_copy_only=False).reshape(len(column), 1)
