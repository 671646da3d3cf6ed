"""The little that is said to the hub: one place for its errors, and for the token, which is never shown."""

from __future__ import annotations

import contextlib
import glob
import json
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import InputError, SpaceDockError

DATASET_FOLDERS = ("data", "meta", "videos", "images")  # all that a dataset is made of, beside its card
LOG_IN = "Log in with `hf auth login`, or set HF_TOKEN."


class HubError(SpaceDockError):
    """The hub refused, failed, or was not reached."""


@contextlib.contextmanager
def hub_errors(doing: str) -> Iterator[None]:
    """Turns what the hub's library raises into one sentence, without the token and without a traceback.

    Raises:
        HubError: what was being done, what the hub said, and what to do.
    """
    import httpx
    from huggingface_hub.errors import HfHubHTTPError

    try:
        yield
    except HfHubHTTPError as error:
        status = error.response.status_code if error.response is not None else None
        if status in (401, 403):
            raise HubError(f"{doing}: the hub refused the token ({status}). {LOG_IN}") from None
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise HubError(f"{doing}: the hub answered {status} ({said}). {AGAIN}") from None
    except (httpx.HTTPError, ConnectionError, TimeoutError) as error:
        raise HubError(f"{doing}: the connection failed ({type(error).__name__}: {error}). {AGAIN}") from None
    except (RuntimeError, OSError) as error:
        raise HubError(f"{doing}: failed ({error}). {AGAIN}") from None


AGAIN = "Nothing here was changed; run the same command again: what has been uploaded is not sent twice."


def checked_token() -> str:
    """The token of the hub library's own places.

    Raises:
        InputError: there is none.
    """
    from huggingface_hub import get_token

    token = get_token()
    if not token:
        raise InputError("hub token", "none", "the token that the hub's library finds", LOG_IN)
    return token


def upload_folder(
    api: Any,
    folder: Path,
    *,
    repo_id: str,
    repo_type: str,
    branch: str | None,
    message: str,
    large: bool,
    ignore: list[str],
) -> str:
    """Uploads a folder: as one commit, or, where ``large``, in several with a record of what is done.

    Of a dataset, what an earlier push left in ``DATASET_FOLDERS`` and this folder does not hold is removed: LeRobot
    reads whatever files lie there, so what is left of a larger version would join this one.

    Returns:
        Where it is.
    """
    shared = {"repo_id": repo_id, "repo_type": repo_type, "folder_path": folder, "ignore_patterns": list(ignore)}
    if large:
        _forget_other_places(api, folder, repo_id=repo_id, repo_type=repo_type, branch=branch)
        with warnings.catch_warnings():  # newer libraries call it deprecated; the oldest that we allow has nothing else
            warnings.simplefilter("ignore", FutureWarning)
            api.upload_large_folder(**shared, revision=branch, print_report=False)
        if repo_type == "dataset":
            _delete_left_over(api, folder, repo_id=repo_id, branch=branch)
        return f"{api.endpoint}/{'' if repo_type == 'model' else repo_type + 's/'}{repo_id}"
    stale = [f"{name}/*" for name in DATASET_FOLDERS] if repo_type == "dataset" else None
    done = api.upload_folder(**shared, revision=branch, commit_message=message, delete_patterns=stale)
    return done.repo_url.url


def _delete_left_over(api: Any, folder: Path, *, repo_id: str, branch: str | None) -> None:
    there = api.list_repo_files(repo_id, repo_type="dataset", revision=branch)
    stale = [p for p in there if p.partition("/")[0] in DATASET_FOLDERS and not (folder / p).is_file()]
    if stale:
        options = {"repo_type": "dataset", "revision": branch, "commit_message": "Remove files of an earlier version"}
        api.delete_files(repo_id, [glob.escape(path) for path in stale], **options)


def _forget_other_places(api: Any, folder: Path, *, repo_id: str, repo_type: str, branch: str | None) -> None:
    """Removes the record of a large upload unless it is of this very place.

    The hub's library writes down which files it has committed but not where to: pushed elsewhere, or to a repository
    that was deleted and made again, it would leave them out.
    """
    record, place_file = folder / ".cache" / "huggingface" / "upload", folder / ".cache" / "spacedock_push.json"
    place = json.dumps([api.endpoint, repo_type, repo_id, branch or "main"])
    arrived = set(api.list_repo_files(repo_id, repo_type=repo_type, revision=branch))
    known = place_file.exists() and place_file.read_text() == place
    if not known or not any((folder / path).is_file() for path in arrived - {"README.md"}):
        shutil.rmtree(record, ignore_errors=True)
    place_file.parent.mkdir(exist_ok=True)
    place_file.write_text(place)


def set_tag(api: Any, tag: str, *, repo_id: str, repo_type: str, branch: str | None) -> None:
    """Points a tag at the head of the branch, moving it where it exists."""
    from huggingface_hub.errors import RevisionNotFoundError

    with contextlib.suppress(RevisionNotFoundError):
        api.delete_tag(repo_id, tag=tag, repo_type=repo_type)
    api.create_tag(repo_id, tag=tag, revision=branch, repo_type=repo_type)
