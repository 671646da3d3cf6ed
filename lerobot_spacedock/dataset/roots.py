"""Where a dataset lives."""

from __future__ import annotations

import re
from pathlib import Path

from lerobot_spacedock.errors import InputError

_REPO_ID = re.compile(r"[\w.-]+/[\w.-]+")


def check_repo_id(repo_id: str) -> None:
    """Raises InputError unless it is ``user/name``."""
    if not _REPO_ID.fullmatch(repo_id):
        raise InputError("--repo_id", repo_id, "user/name, of letters, digits, '-', '_' and '.'")


def dataset_root(repo_id: str, root: str | None) -> Path:
    """The folder of a dataset: ``root``, or LeRobot's own place for ``repo_id``."""
    if root is not None:
        return Path(root)
    from lerobot.utils.constants import HF_LEROBOT_HOME

    return HF_LEROBOT_HOME / repo_id


def existing_root(repo_id: str, root: str | None) -> Path:
    """The same of a dataset that has to be there already.

    Raises:
        InputError: no LeRobotDataset v3.0 is there.
    """
    path = dataset_root(repo_id, root)
    if not (path / "meta" / "info.json").exists():
        raise InputError("--root", str(path), "the folder of a LeRobotDataset (it holds meta/info.json)")
    return path
