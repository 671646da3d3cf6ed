"""What an episode was flown to do: which runs can be compared start by start, and which cannot."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lerobot_spacedock.metrics.episode import ends_at_contact, port_of

_NOT_IN_NAMES = re.compile(r"[^\w.+-]+", re.ASCII)


@dataclass(frozen=True)
class Task:
    """A task, a port, and whether to touch it.

    Attributes:
        env_id: gymnasium id; ``None`` where a log does not say.
        port: name of the port.
        contact: the aim is to touch the port, so that the last state is where a flight did.
    """

    env_id: str | None
    port: str
    contact: bool

    def __str__(self) -> str:
        return f"{self.env_id or 'task not stated'} at {self.port}" + (", to contact" if self.contact else "")

    def agrees(self, other: Task) -> bool:
        """Whether nothing that both state sets the two apart."""
        same_id = self.env_id == other.env_id or None in (self.env_id, other.env_id)
        return same_id and (self.port, self.contact) == (other.port, other.contact)


def task_of(metadata: Mapping[str, Any]) -> Task:
    """The task that a log's metadata state."""
    return Task(plain_name(metadata.get("env_id")), port_of(metadata).name, ends_at_contact(metadata))


def plain_name(stated: object) -> str | None:
    """What a log calls something, fit for file names, anchors and tables: what cannot stand there is an underscore."""
    return _NOT_IN_NAMES.sub("_", stated)[:60] if isinstance(stated, str) and stated else None
