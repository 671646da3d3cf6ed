"""Under what licence a dataset is, by the hub's short names: ours is ours to state, that of others' rollouts is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

OWN, UNKNOWN = "apache-2.0", "unknown"


def license_of(facts: dict[str, Any]) -> str:
    """What the source states, else our own of what was flown in this package's environments, else unknown.

    Args:
        facts: ``meta/spacedock.json``.
    """
    flown_here = facts.get("made_by") == "spacedock demos" or (facts.get("source") or {}).get("format") == "logs"
    return facts.get("license") or (OWN if flown_here else UNKNOWN)


def stated_license(root: Path) -> str | None:
    """What the card at ``root`` says in its header; None without one."""
    from huggingface_hub import RepoCard

    try:
        return RepoCard.load(root / "README.md", ignore_metadata_errors=True).data.get("license")
    except (OSError, ValueError, AttributeError):
        return None
