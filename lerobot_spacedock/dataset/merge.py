"""Puts many small datasets together by LeRobot's ``aggregate_datasets``, in memory that hardly grows with them."""

from __future__ import annotations

import contextlib
import logging
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.dataset.encoder import quiet_encoders
from lerobot_spacedock.dataset.record import datasets_cache, prepare_libraries
from lerobot_spacedock.dataset.shards import SUMMARY_FILE
from lerobot_spacedock.files import aside

if TYPE_CHECKING:
    import pandas as pd

# LeRobot rewrites the file it appends to once for each dataset that it merges
MERGE_AT_ONCE = 8
# rows of one file of episodes' metadata, which LeRobot holds as pandas objects when it merges again: some 25 kB each
EPISODES_A_FILE = 500
ROWS_AT_ONCE = 256


def merge_by_parts(shards: list[Path], repo_id: str, scratch: Path, complete: Path) -> None:
    """Merges a few at a time, and what comes of that again, so that neither memory nor time an episode grow.

    From the second round on data files are taken as they are: several, of hundreds of episodes each.

    Args:
        shards: roots of the datasets, in order; one at least.
        repo_id: name of the result.
        scratch: folder for what is merged on the way.
        complete: root of the result.
    """
    level = 0
    while len(shards) > MERGE_AT_ONCE:
        parts = [shards[at : at + MERGE_AT_ONCE] for at in range(0, len(shards), MERGE_AT_ONCE)]
        folder = scratch / str(level)
        shutil.rmtree(folder, ignore_errors=True)
        merged = [folder / f"{number:06d}" for number in range(len(parts))]
        for part, target in zip(parts, merged, strict=True):
            _merge(part, repo_id, target, concatenate=level == 0)
        if level:
            shutil.rmtree(scratch / str(level - 1))
        shards, level = merged, level + 1
    _merge(shards, repo_id, complete, concatenate=level == 0)


def _merge(shards: list[Path], repo_id: str, complete: Path, *, concatenate: bool) -> None:
    if len(shards) == 1:
        shutil.copytree(shards[0], complete, ignore=shutil.ignore_patterns(SUMMARY_FILE))
        return
    from lerobot.datasets.aggregate import aggregate_datasets

    quiet_encoders()
    prepare_libraries()
    quiet = logging.getLogger("lerobot.datasets.aggregate")
    before = quiet.level
    quiet.setLevel(logging.WARNING)
    try:
        with datasets_cache(complete.with_name(f"{complete.name}_cache")), _bounded_metadata():
            aggregate_datasets(
                [repo_id] * len(shards), repo_id, roots=shards, aggr_root=complete, concatenate_data=concatenate
            )
    finally:
        quiet.setLevel(before)


@contextlib.contextmanager
def _bounded_metadata() -> Iterator[None]:
    """Has LeRobot append episodes' metadata by ``append_episodes``; all else it writes as it does."""
    from lerobot.datasets import aggregate

    original: Callable[..., Any] = aggregate.append_or_create_parquet_file

    def append(df, src_path, idx, max_mb, chunk_size, default_path, **options):
        if default_path != aggregate.DEFAULT_EPISODES_PATH:
            return original(df, src_path, idx, max_mb, chunk_size, default_path, **options)
        return append_episodes(df, options["aggr_root"], idx, chunk_size, default_path)

    aggregate.append_or_create_parquet_file = append
    try:
        yield
    finally:
        aggregate.append_or_create_parquet_file = original


def append_episodes(
    df: pd.DataFrame, root: Path, idx: dict[str, int], files_a_chunk: int, place: str
) -> tuple[dict[str, int], tuple[int, int]]:
    """Appends rows of episodes' metadata to the newest file, or to a new one where that is full.

    LeRobot's own holds a whole file as pandas objects for each append, and begins a new one at 100 MB (26,000 episodes)
    with rows that still name the file before: a later merge of what came out then passes those episodes over.

    Args:
        df: the rows, one an episode.
        root: of the dataset.
        idx: {"chunk", "file"} of the newest file; moved on where a new one begins.
        files_a_chunk: files of a folder.
        place: the file's place below ``root``, for ``chunk_index`` and ``file_index``.

    Returns:
        ``idx``, and (chunk, file) that the rows are in.
    """
    path = root / place.format(chunk_index=idx["chunk"], file_index=idx["file"])
    if path.exists() and pq.read_metadata(path).num_rows + len(df) > EPISODES_A_FILE:
        chunk, file = divmod(idx["chunk"] * files_a_chunk + idx["file"] + 1, files_a_chunk)
        idx.update(chunk=chunk, file=file)
        path = root / place.format(chunk_index=chunk, file_index=file)
    df["meta/episodes/chunk_index"], df["meta/episodes/file_index"] = idx["chunk"], idx["file"]
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        df.to_parquet(path)
        return idx, (idx["chunk"], idx["file"])
    with pq.ParquetFile(path) as file:
        schema = file.schema_arrow.remove_metadata()
        with aside(path) as own, pq.ParquetWriter(own, schema, compression="snappy") as writer:
            for batch in file.iter_batches(ROWS_AT_ONCE):
                writer.write_table(pa.Table.from_batches([batch]).replace_schema_metadata())
            writer.write_table(pa.Table.from_pandas(df, schema, preserve_index=False))
    return idx, (idx["chunk"], idx["file"])
