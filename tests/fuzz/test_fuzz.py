"""Hostile files, a few hundred to each reader; ``python tests/fuzz/run.py --inputs 10000`` tries more."""

import json
import os

import pytest
from dataset_readers import make_dataset
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reader import an_episode
from readers import READERS
from run import available, fuzz

from lerobot_spacedock.episode_log import write_episode_log
from lerobot_spacedock.errors import FileFormatError, SpaceDockError
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.samples import read_samples

# these cost milliseconds each
QUICK = {"options and sweeps (YAML)": 60, "hub repositories": 12} | {
    f"LeRobotDatasets{what}": 40 for what in ("", ", checked", ", imitated")
}
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=12,
)
KEYS = ("config", "port", "contact", "dynamics", "initial_conditions", "success", "clipped_actions", "inference")


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_a_damaged_file_is_read_or_refused_by_name(reader):
    if not available(reader):
        pytest.skip("an optional module is not installed")
    assert fuzz(reader, QUICK.get(reader.name, 200)).failures == {}


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_ten_thousand_damaged_files(reader):
    if not available(reader):
        pytest.skip("an optional module is not installed")
    result = fuzz(reader, 10_000, first=1_000_000)
    assert result.failures == {}
    assert result.inputs == 10_000


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.dictionaries(st.sampled_from(KEYS), ANYTHING, max_size=4))
def test_a_log_may_say_anything_of_itself(tmp_path, metadata):
    log = an_episode()
    log.metadata.clear()
    log.metadata.update(metadata)
    path = write_episode_log(tmp_path / "episode_000001.parquet", log)
    sets, excluded = collect([[path]], workers=1)
    assert sum(map(len, sets.values())) + len(excluded) == 1
    assert all(str(path) in exclusion.reason for exclusion in excluded)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(ANYTHING)
def test_a_training_record_may_hold_anything(tmp_path, record):
    path = tmp_path / "training.json"
    path.write_text(json.dumps(record))
    said = str(path)
    try:
        read_samples([f"A={path}"], [], {"A": []})
    except SpaceDockError as error:
        said = str(error)
    assert str(path) in said


@pytest.mark.parametrize("reader", [r for r in READERS if "JSON" in r.name or "YAML" in r.name], ids=lambda r: r.name)
def test_a_document_nested_beyond_any_depth_is_refused_by_name(tmp_path, reader):
    (file, _), *_ = reader.make(tmp_path)
    file.write_text("[" * 100_000)
    with pytest.raises(SpaceDockError, match=file.name):
        reader.read(file)


def test_a_dataset_cannot_send_its_reader_elsewhere(tmp_path):
    from lerobot_spacedock.dataset.stored_episode import DatasetEpisode

    make_dataset(tmp_path)
    root = tmp_path / "dataset"
    outside = tmp_path / "elsewhere.parquet"
    os.link(next((root / "data").rglob("*.parquet")), outside)
    info = json.loads((root / "meta" / "info.json").read_text())
    for template in ("../elsewhere.parquet", str(outside)):
        (root / "meta" / "info.json").write_text(json.dumps(info | {"data_path": template}))
        with pytest.raises(FileFormatError, match="leads out of the dataset"):
            DatasetEpisode(root, 0).log()


def test_a_log_that_claims_a_billion_states_is_refused_before_it_is_read(tmp_path):
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    from lerobot_spacedock.episode_log import COLUMNS, MAX_STATES, read_episode_log

    rows = MAX_STATES + 1
    column = pa.DictionaryArray.from_arrays(np.zeros(rows, np.int8), pa.array([1.0])).cast(pa.float64())
    path = tmp_path / "episode_000001.parquet"
    pq.write_table(pa.table(dict.fromkeys(COLUMNS, column)), path)
    assert path.stat().st_size < rows  # 23 columns of 8 bytes, if it were read
    with pytest.raises(FileFormatError, match="rows; an episode log has 1 to"):
        read_episode_log(path)
