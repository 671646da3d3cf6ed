"""Where a dataset lives."""

from __future__ import annotations

import re
from pathlib import Path

from lerobot_spacedock.errors import FileFormatError, InputError, reading

_REPO_ID = re.compile(r"[\w.-]+/[\w.-]+")


def check_repo_id(repo_id: str) -> None:
    """Raises InputError unless it is ``user/name``, and one that the hub takes."""
    if not _REPO_ID.fullmatch(repo_id):
        raise InputError("--repo_id", repo_id, "user/name, of letters, digits, '-', '_' and '.'")
    from huggingface_hub.errors import HFValidationError
    from huggingface_hub.utils import validate_repo_id

    try:
        validate_repo_id(repo_id)
    except HFValidationError as error:
        raise InputError("--repo_id", repo_id, "a name that the hub takes", str(error)) from error


def dataset_root(repo_id: str, root: str | None) -> Path:
    """The folder of a dataset: ``root``, or LeRobot's own place for ``repo_id``."""
    if root is not None:
        return Path(root)
    from lerobot.utils.constants import HF_LEROBOT_HOME

    return HF_LEROBOT_HOME / repo_id


def existing_root(repo_id: str, root: str | None, *, downloaded: bool = False) -> Path:
    """The same of a dataset that has to be there already.

    Args:
        repo_id: user/name.
        root: its folder, where the user named one.
        downloaded: what LeRobot has fetched from the hub will do too; only to be read, it is the hub library's cache.

    Raises:
        InputError: no LeRobotDataset v3.0 is there.
    """
    path = dataset_root(repo_id, root)
    if (path / "meta" / "info.json").exists():
        return path
    found = _downloads(repo_id) if downloaded and root is None else []
    if not found:
        made = "Make one with spacedock demos or spacedock convert."
        raise InputError("--root", str(path), "the folder of a LeRobotDataset (it holds meta/info.json)", made)
    return max(found, key=lambda folder: folder.stat().st_mtime)


def _downloads(repo_id: str) -> list[Path]:
    from lerobot.utils.constants import HF_LEROBOT_HUB_CACHE

    snapshots = HF_LEROBOT_HUB_CACHE / f"datasets--{repo_id.replace('/', '--')}" / "snapshots"
    return [info.parents[1] for info in snapshots.glob("*/meta/info.json")]


def dataset_file(root: Path, template: str, **words: object) -> Path:
    """The file that a dataset's ``info.json`` means by ``template``.

    Raises:
        FileFormatError: it is not in the dataset's folder.
    """
    with reading(root / "meta" / "info.json", "a dataset's description"):
        path = root / template.format(**words)
        inside = is_inside(root, path)
    if not inside:
        raise FileFormatError(f"{root / 'meta' / 'info.json'}: {template!r} leads out of the dataset, to {path}.")
    return path


def is_inside(root: Path, path: Path) -> bool:
    """Whether ``path``, links followed, is in ``root``.

    A snapshot in the hub library's cache holds nothing but links to the contents beside it: these count as inside.
    """
    whole = root.resolve()
    homes = [whole, whole.parents[1] / "blobs"] if whole.parent.name == "snapshots" else [whole]
    return any(path.resolve().is_relative_to(home) for home in homes)
