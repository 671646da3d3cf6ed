"""Repositories as their owner may have named the files in them, to climb out of where they are fetched to."""

from __future__ import annotations

import base64
import json

import numpy as np
from mutations import mutate_bytes

STEPS = ("..", "../..", ".", "", "~", "meta", "data", "..\\..", "C:\\x", "%2e%2e", "..%2f..", "\x00", "\u202e", "..;")
STEPS += (".git", ".cache/huggingface/download", "con", " ", "-rf", "$HOME", "*", "escaped.txt", "\u2025", "x" * 300)


def hostile_path(rng: np.random.Generator, known: list[str]) -> str:
    """A name that climbs out, begins at the root, hides what it is, or runs into one that is there."""
    steps = "/".join(STEPS[int(i)] for i in rng.integers(0, len(STEPS), int(rng.integers(1, 6))))
    folder, _, name = known[int(rng.integers(len(known)))].rpartition("/")
    match int(rng.integers(0, 5)):
        case 0:
            return "../" * int(rng.integers(1, 12)) + steps
        case 1:
            return f"/{steps}"
        case 2:
            return f"{folder}/{name}/{steps}"
        case 3:
            return f"{folder}/{steps}/{name}"
        case _:
            return steps


def repository(rng: np.random.Generator, data: bytes) -> bytes:
    """A repository, {path: content in base64}, with files added or moved to hostile paths, taken out, or damaged."""
    files: dict[str, str] = json.loads(data)
    for _ in range(int(rng.integers(1, 5))):
        name = list(files)[int(rng.integers(len(files)))]
        match int(rng.integers(0, 6)):
            case 0 | 1:
                files[hostile_path(rng, list(files))] = files[name]
            case 2 | 3:
                place = hostile_path(rng, list(files))
                files[place] = files.pop(name)
            case 4 if len(files) > 1:
                files.pop(name)
            case _ if files[name]:  # an empty file has no byte to damage
                files[name] = base64.b64encode(mutate_bytes(rng, base64.b64decode(files[name]))).decode()
    return json.dumps(files).encode()
