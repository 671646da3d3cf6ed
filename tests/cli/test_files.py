"""Files that are there whole or not at all."""

import os

import pytest

from lerobot_spacedock.files import ABANDONED_AFTER_s, aside, remove_abandoned, write_text


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.json"
    write_text(path, "old")
    for shared in (False, True):
        with pytest.raises(UnicodeEncodeError), aside(path, shared=shared) as own:
            own.write_text("half \udcff", encoding="utf-8")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.json", "old")]


def test_what_a_kill_left_is_removed_once_it_is_old_and_no_other_file(tmp_path):
    path = tmp_path / "a[1].json"
    old, new, others = (tmp_path / f".{name}.tmp" for name in ("a[1].json.4711", "a[1].json.4712", "b.json.4711"))
    for file in (path, old, new, others):
        file.write_text("half")
    long_ago = path.stat().st_mtime - ABANDONED_AFTER_s - 60.0
    for file in (path, old, others):
        os.utime(file, (long_ago, long_ago))
    remove_abandoned(path)
    assert sorted(tmp_path.iterdir()) == sorted([path, new, others])
