"""Folders that a command is about to write: found out before the work, in one line each."""

from pathlib import Path

import pytest

from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.folders import check_writable, disk_errors, only_process

TOO_LONG = "a" * 300


def test_the_folder_one_stands_in_has_one_writer_too(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with only_process(Path("."), "--out"):
        for same in (folder, Path("."), Path("../out"), folder / "deeper" / ".."):
            with pytest.raises(InputError, match="no other process is writing"), only_process(same, "--out"):
                pass
    with only_process(folder, "--out"):
        pass
    assert list(tmp_path.rglob("*.lock")) == []


def test_the_root_is_refused():
    with (
        pytest.raises(InputError, match="--out: got /; allowed: a folder below the root"),
        only_process(Path("/"), "--out"),
    ):
        pass


def test_a_folder_that_cannot_be_made_is_found_out(tmp_path):
    check_writable(tmp_path / "new" / "newer", "--out")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    for place, reason in ((tmp_path / TOO_LONG, "File name too long"), (tmp_path / "file", "Not a directory")):
        with pytest.raises(InputError, match=f"--out: .*{reason}"):
            check_writable(place, "--out")


def test_what_the_system_refuses_is_one_line_with_the_room_left(tmp_path):
    said = r"File name too long.* MB are free there\. Kept\."
    with pytest.raises(SpaceDockError, match=said), disk_errors(tmp_path / TOO_LONG, "Kept."):
        (tmp_path / TOO_LONG).mkdir()
