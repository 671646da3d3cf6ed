"""A JSON object in a file, which anybody may have made."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import FileFormatError


def read_object(path: Path) -> dict[str, Any]:
    """The object that the file holds.

    Raises:
        FileFormatError: the file is missing or not JSON, or holds something else.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: not JSON ({error}).") from error
    if not isinstance(value, dict):
        raise FileFormatError(f"{path}: {type(value).__name__}, not a JSON object.")
    return value
