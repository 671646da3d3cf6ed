"""What an env config cannot be told by LeRobot: which command runs it, and that command's options.

Stock LeRobot hands an env config neither the output folder nor the number of episodes, and both decide where the
episode logs go. They are read back from the command line and the file of ``--config_path``, as LeRobot itself does
for ``--policy.path``; in any other program nothing is guessed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from draccus.utils import DecodingError
from lerobot.utils.constants import OBS_IMAGES

from lerobot_spacedock.errors import FileFormatError, InputError, SpaceDockError, reading
from lerobot_spacedock.files import read_object

COMMANDS = ("lerobot_eval", "lerobot_train")


class OptionError(SpaceDockError, DecodingError):
    """An option that cannot be used, as draccus raises it: LeRobot's commands print it as one line and stop.

    Ours from a config's constructor would be a ``ValueError``, which draccus hides behind its own.
    """

    def __init__(self, error: SpaceDockError) -> None:
        DecodingError.__init__(self, (), str(error))


@contextmanager
def option_errors() -> Iterator[None]:
    """Turns an ``InputError`` or a ``FileFormatError`` inside into an ``OptionError``."""
    try:
        yield
    except (InputError, FileFormatError) as error:
        raise OptionError(error) from error


def running_command() -> str | None:
    """``lerobot_eval`` or ``lerobot_train`` where one of them is what runs (script, ``-m`` or accelerate), or None."""
    name = Path(sys.argv[0]).stem.replace("-", "_") if sys.argv and sys.argv[0] else ""
    return name if name in COMMANDS else None


def command_option(name: str) -> Any:
    """The value that the running LeRobot command was given for a dotted option, from flag or file; None if neither."""
    from lerobot.configs import parser

    if running_command() is None:
        return None
    flag = _flag(name)
    return flag if flag is not None else _file_option(parser.parse_arg("config_path"), name)


def _flag(name: str) -> str | None:
    """The last of the flags of that name, as LeRobot's commands take it; of a ``.path`` they take the first."""
    from lerobot.configs import parser

    if name.endswith(f".{parser.PATH_KEY}"):
        return parser.parse_arg(name)
    starts = range(len(sys.argv) - 1, 0, -1)
    return next((flag for at in starts if (flag := parser.parse_arg(name, sys.argv[at:])) is not None), None)


def output_dir() -> Path | None:
    """The output folder that the running LeRobot command was given, or None where it invents one."""
    value = command_option("output_dir")
    return Path(value) if value and value != "null" else None


def resumed_step() -> int:
    """The training step that the running ``lerobot-train --resume=true`` goes on from; 0 where it begins."""
    from lerobot.configs import parser
    from lerobot.utils.constants import TRAINING_STATE_DIR, TRAINING_STEP

    path = parser.parse_arg("config_path")
    if path is None or str(command_option("resume")).lower() != "true":
        return 0
    record = Path(path).resolve().parents[1] / TRAINING_STATE_DIR / TRAINING_STEP
    return int(read_object(record)["step"]) if record.is_file() else 0


def num_episodes() -> int | None:
    """How many episodes an evaluation of the running LeRobot command counts; the rest of its last batch is surplus."""
    from lerobot.configs.default import EvalConfig

    if running_command() is None or _names_a_remote_config():
        return None
    value = command_option("eval.n_episodes")
    return int(value) if value is not None else EvalConfig.n_episodes


def env_option(name: str) -> Any:
    """An option of the env that the running command evaluates in: as given, or as the env's id sets it."""
    from lerobot_spacedock.env.registration import ENV_IDS

    given = command_option(f"env.{name}")
    if given is not None and given != "null":
        return given
    return ENV_IDS.get(command_option("env.task"), {}).get(name)


def env_decides(name: str) -> bool:
    """Whether an option of the policy follows the command's env: one runs, and was given no ``--policy.NAME``."""
    return running_command() is not None and command_option(f"policy.{name}") in (None, "null")


def trained_picture_size() -> tuple[int, int] | None:
    """Rows and columns of the pictures that the command's policy saw, or its dataset holds; None if none is named here.

    LeRobot compares the names of pictures, not their sizes, and a ResNet takes any: a policy that is shown another size
    than it learnt from would fly, badly, without a word.

    Raises:
        FileFormatError: the file that would say so is damaged.
    """
    dataset = dataset_folder(command_option("dataset.root"), command_option("dataset.repo_id"))
    for option, path, key in (
        ("dataset", None if dataset is None else dataset / "meta" / "info.json", "features"),
        ("policy.path", policy_file("config.json"), "input_features"),
    ):
        if path is None:
            continue
        with reading(path, f"what --{option} holds"):
            feature = read_object(path).get(key, {}).get(f"{OBS_IMAGES}.camera")
            if feature:
                rows, columns = (size for size in feature["shape"] if size != 3)
                return int(rows), int(columns)
    return None


def policy_file(name: str) -> Path | None:
    """A file of the policy that the command flies: of its folder, or of what was fetched of its hub repository."""
    from huggingface_hub import try_to_load_from_cache

    given = command_option("policy.path")
    if not given:
        return None
    folder = Path(given).expanduser()
    if folder.exists():
        return folder / name if (folder / name).is_file() else None
    revision = command_option("policy.pretrained_revision")
    return _cached(lambda: try_to_load_from_cache(given, name, revision=revision))


def dataset_folder(root: str | None, repo_id: str | None) -> Path | None:
    """Where a dataset lies: the folder that was named, LeRobot's own for its name, or what was fetched of the hub."""
    from lerobot.utils.constants import HF_LEROBOT_HOME, HF_LEROBOT_HUB_CACHE

    folders = [Path(root).expanduser()] if root else []
    folders += [HF_LEROBOT_HOME / repo_id] if repo_id else []
    for folder in folders:
        if (folder / "meta" / "info.json").is_file():
            return folder
    if root or not repo_id:
        return None
    from huggingface_hub import try_to_load_from_cache
    from lerobot.datasets.dataset_metadata import CODEBASE_VERSION

    where = {"repo_type": "dataset", "cache_dir": HF_LEROBOT_HUB_CACHE}
    where["revision"] = command_option("dataset.revision") or CODEBASE_VERSION
    info = _cached(lambda: try_to_load_from_cache(repo_id, "meta/info.json", **where))
    return None if info is None else info.parents[1]


def _cached(look: Callable[[], object]) -> Path | None:
    from huggingface_hub.errors import HFValidationError

    try:
        found = look()
    except HFValidationError:  # no name of a repository
        return None
    return Path(found) if isinstance(found, str) else None


def refuse_missing_checkpoint() -> None:
    """Raises ``InputError`` where ``--policy.path`` can only be a folder and is none: LeRobot would ask the hub."""
    given = command_option("policy.path")
    if not given or Path(given).expanduser().exists():
        return
    if given.startswith(("/", ".", "~")) or given.count("/") > 1:  # a repository is called user/name
        mend = "A training writes it to OUTPUT_DIR/checkpoints/last/pretrained_model."
        raise InputError("--policy.path", given, "a folder that exists, or a hub repository, user/name", mend)


def _names_a_remote_config() -> bool:
    from lerobot.configs import parser

    path = parser.parse_arg("config_path")
    return path is not None and not Path(path).exists()


def _file_option(path: str | None, name: str) -> Any:
    if path is None or not Path(path).exists():
        return None
    file = Path(path)
    if file.is_dir():
        file = file / "train_config.json"
    if not file.is_file():
        return None
    if file.suffix == ".json":
        node = json.loads(file.read_text())
    else:
        import yaml

        node = yaml.safe_load(file.read_text())
    for key in name.split("."):
        node = node.get(key) if isinstance(node, dict) else None
    return node
