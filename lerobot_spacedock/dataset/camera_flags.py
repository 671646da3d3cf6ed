"""The camera's options as flags that may be left out: what is not asked for is as something else has it."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from lerobot_spacedock.camera import CameraConfig, SensorConfig


def _none_by_default(cls: type) -> type:
    """Gives what a class inherits from a dataclass None as default; checked is only what ``over`` makes of it."""
    own = inspect.get_annotations(cls)
    inherited = [item for item in fields(cls) if item.name not in own]
    cls.__annotations__ = {item.name: f"{item.type} | None" for item in inherited} | own
    for item in inherited:
        setattr(cls, item.name, None)
    cls.__post_init__ = lambda self: None
    return cls


@dataclass(frozen=True)
@_none_by_default
class SensorFlags(SensorConfig):
    """Noise, blur, distortion, bloom; what is left out as below."""


@dataclass(frozen=True)
@_none_by_default
class CameraFlags(CameraConfig):
    """The camera. Left out, an option is what the flights state, the size that of the first stored picture."""

    sensor: SensorFlags = field(default_factory=SensorFlags)


def over(asked: Any, base: Any) -> Any:
    """``base`` with what was asked for in its place.

    Args:
        asked: CameraFlags, or a CameraConfig, of which everything counts as asked for.
        base: CameraConfig.

    Raises:
        InputError: an option out of its range.
    """
    given = {item.name: getattr(asked, item.name) for item in fields(asked) if getattr(asked, item.name) is not None}
    nested = {name: over(value, getattr(base, name)) for name, value in given.items() if is_dataclass(value)}
    return replace(base, **given | nested)
