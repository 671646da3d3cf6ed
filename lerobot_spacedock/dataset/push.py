"""``spacedock push``: a dataset, a policy or the environment goes to the hub, with a card made from what it is."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from lerobot_spacedock.dataset.card import write_card
from lerobot_spacedock.dataset.hub import HubError, checked_token, hub_errors, set_tag, upload_folder
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.licence import OWN
from lerobot_spacedock.dataset.model_card import evaluation_command, write_model_card
from lerobot_spacedock.dataset.next_commands import train_command
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.roots import check_repo_id, existing_root, is_inside
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.folders import free_space

KINDS = ("dataset", "policy", "env")
CARD_LINES = 60  # of a card, in a dry run
LARGE_BYTES = 2 * 1024**3
# as the hub's library reads patterns: a star stands for slashes too
IGNORED = [".git/*", ".cache/*", "images/*", "*.tmp", "*.part/*"]


@dataclass
class PushConfig:
    """Publish a dataset, a policy or the environment, with its card."""

    # user/name on the hub
    repo_id: str
    # dataset | policy | env
    kind: str = "dataset"
    # folder of the dataset, by default LeRobot's own place for this repo_id; or of the policy (its pretrained_model)
    root: str | None = None
    # show what would be pushed and write the card, without a word to the hub
    dry_run: bool = False
    # whether a new repository is private
    private: bool = True
    # branch to push to, made where it does not exist; by default main
    branch: str | None = None
    # tags of the card
    tags: list[str] = field(default_factory=list)
    # further git tag to set, such as v1.0; LeRobot's own version tag is always set for datasets
    revision_tag: str | None = None
    # licence of what is pushed, by the hub's short name; by default apache-2.0, and of rollouts that others made what
    # their source states, or unknown
    license: str | None = None
    # upload in several commits with a record of progress: auto does so above 2 GB | always | never
    large: str = "auto"
    # push although the check found errors
    force: bool = False
    # policy: episode logs of its evaluation, in this folder or in folders below it, whose results go on the card
    log_dir: str | None = None


def push(config: PushConfig) -> int:
    """Runs the verb; see the module.

    Raises:
        InputError: nothing to push, a dataset that fails its check, or no token.
        HubError: the hub refused, failed or was not reached. Nothing local changes, and the same command goes on.
    """
    check_repo_id(config.repo_id)
    if config.kind not in KINDS:
        raise InputError("--kind", config.kind, " | ".join(KINDS))
    if config.large not in ("auto", "always", "never"):
        raise InputError("--large", config.large, "auto | always | never")
    if config.log_dir is not None and config.kind != "policy":
        raise InputError("--log_dir", config.log_dir, "nothing, unless --kind=policy")
    with tempfile.TemporaryDirectory() as scratch:
        try:
            folder = _prepare(config, Path(scratch))
        except OSError as error:
            place = Path(config.root or scratch)
            raise SpaceDockError(f"{place}: the card cannot be written ({error}). {free_space(place)}") from error
        return _upload(config, folder)


def _prepare(config: PushConfig, scratch: Path) -> Path:
    """The folder to push, complete with its card."""
    if config.kind == "dataset":
        root = existing_root(config.repo_id, config.root)
        report = check_dataset(root, sample_frames=4, redraw=False)
        if not report.ok and not config.force:
            raise InputError(
                "--root", str(root), "a dataset that passes spacedock check", f"{report.errors[0]} (--force pushes it.)"
            )
        write_card(root, config.repo_id, license_id=config.license, tags=tuple(config.tags))
        return root
    if config.kind == "policy":
        folder = Path(config.root or "")
        if config.root is None or not (folder / "config.json").exists():
            raise InputError("--root", config.root, "the pretrained_model folder of a policy (it holds config.json)")
        write_model_card(
            folder, config.repo_id, config.log_dir, license_id=config.license or OWN, tags=tuple(config.tags)
        )
        return folder
    from lerobot_spacedock.dataset.env_hub import write_env_hub

    write_env_hub(scratch, config.repo_id, license_id=config.license or OWN, tags=tuple(config.tags))
    return scratch


def _upload(config: PushConfig, folder: Path) -> int:
    files = _sent(folder)
    for file in files:
        if not is_inside(folder, file):
            raise InputError("--root", str(file), "files of that folder", f"It is a link to {file.resolve()}.")
    size = sum(file.stat().st_size for file in files)
    large = config.large == "always" or (config.large == "auto" and size > LARGE_BYTES)
    where = f"{config.repo_id} ({config.kind}, {'private' if config.private else 'public'} if new)"
    print(f"{len(files)} files, {size / 1e6:.1f} MB → {where}, branch {config.branch or 'main'}")
    if config.dry_run:
        for file in sorted(files)[:50]:
            print(f"  {file.relative_to(folder)}  {file.stat().st_size} bytes")
        card = (folder / "README.md").read_text()
        lines = card.splitlines()
        print("\n".join(["--- README.md", *lines[:CARD_LINES]]))
        if len(lines) > CARD_LINES:
            print(f"… {len(lines) - CARD_LINES} more lines, in {folder / 'README.md'}")
        print("Dry run: nothing was sent. Next: the same command without --dry_run")
        return 0
    from huggingface_hub import HfApi

    api = HfApi(token=checked_token())
    repo_type = "dataset" if config.kind == "dataset" else "model"
    shared = {"repo_id": config.repo_id, "repo_type": repo_type}
    with hub_errors("asking who the token belongs to"):
        api.whoami()
    with hub_errors(f"making the repository {config.repo_id}"):
        api.create_repo(**shared, private=config.private, exist_ok=True)
        tagged = {tag.name for tag in api.list_repo_refs(**shared).tags}
        if config.revision_tag in tagged:
            mend = f"Or take it away first: hf repo tag delete {config.repo_id} {config.revision_tag}"
            raise InputError("--revision_tag", f"{config.revision_tag}, which is set already", "a new tag", mend)
        if config.branch is not None:
            api.create_branch(**shared, branch=config.branch, exist_ok=True)
    with hub_errors("uploading"):
        url = upload_folder(
            api, folder, **shared, branch=config.branch, message=f"Push {config.kind}", large=large, ignore=IGNORED
        )
    with hub_errors("tagging"):
        for tag in _tags(config, tagged):
            set_tag(api, tag, **shared, branch=config.branch)
    print(f"Pushed to {url}")
    print(f"Next: {_next(config, folder)}")
    return 0


def _sent(folder: Path) -> list[Path]:
    """The files that the hub's library will take, by the patterns that it is given."""
    from huggingface_hub.utils import filter_repo_objects

    files = (file for file in folder.rglob("*") if file.is_file())
    return list(filter_repo_objects(files, ignore_patterns=IGNORED, key=lambda file: str(file.relative_to(folder))))


def _tags(config: PushConfig, tagged: set[str]) -> list[str]:
    """The tags to set: LeRobot's own first, by which it loads a dataset, then the user's."""
    tags = [config.revision_tag] if config.revision_tag else []
    if config.kind == "dataset":
        from lerobot.datasets.dataset_metadata import CODEBASE_VERSION

        # a branch leaves it where it is: what everybody loads by the dataset's name stays what it was
        if config.branch in (None, "main") or CODEBASE_VERSION not in tagged:
            tags.insert(0, CODEBASE_VERSION)
        else:
            print(
                f"LeRobot's tag {CODEBASE_VERSION} stays where it is; to load this: --dataset.revision={config.branch}"
            )
    return tags


def _next(config: PushConfig, folder: Path) -> str:
    if config.kind == "dataset":
        command = " ".join(train_command(DatasetReader(folder), config.repo_id))
        on_main = config.branch in (None, "main") or not command.startswith("lerobot-train")
        return command if on_main else f"{command} --dataset.revision={config.branch}"
    if config.kind == "policy":
        return " ".join([*evaluation_command(folder, config.repo_id), "…"])
    return f'lerobot.envs.factory.make_env("{config.repo_id}", trust_remote_code=True)'


__all__ = ["HubError", "PushConfig", "push"]
