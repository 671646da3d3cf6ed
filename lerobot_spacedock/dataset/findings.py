"""What a check finds, and how it is said."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Report:
    """What was found.

    Attributes:
        errors, warnings, notes: sentences, each beginning with where.
        checks: how often each check ran, over episodes or files.
        worst: largest dynamics residuals over all steps, by the keys of ``residuals.TOLERANCES``.
        unsure: how many episodes have a residual beyond its tolerance where times were assumed.
        episodes, frames: sizes.
        psnr_dB: least and median of the frames that were drawn again; None without.
    """

    errors: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    checks: Counter = field(default_factory=Counter)
    worst: dict[str, float] = field(default_factory=dict)
    unsure: Counter = field(default_factory=Counter)
    episodes: int = 0
    frames: int = 0
    psnr_dB: tuple[float, float] | None = None

    @property
    def ok(self) -> bool:
        return not self.errors

    def to_dict(self) -> dict[str, Any]:
        return {
            "ok": self.ok,
            "episodes": self.episodes,
            "frames": self.frames,
            "errors": self.errors,
            "warnings": self.warnings,
            "notes": self.notes,
            "checks": dict(self.checks),
            "worst_residuals": self.worst,
            "psnr_dB": self.psnr_dB,
        }


class Problems:
    """Adds to the report what is wrong with one episode, naming rows."""

    def __init__(self, report: Report, where: str) -> None:
        self.report, self.where = report, where

    def error(self, what: str) -> None:
        self.report.errors.append(f"{self.where}: {what}.")

    def note_once(self, what: str) -> None:
        """A note on all episodes alike; said once."""
        if what not in self.report.notes:
            self.report.notes.append(what)

    def all_rows(self, good: np.ndarray, what: str, *, warning: bool = False) -> bool:
        """Reports the first row that is not good; True where all are."""
        bad = np.flatnonzero(~good)
        if bad.size:
            target = self.report.warnings if warning else self.report.errors
            target.append(f"{self.where}, frame {bad[0]}: {what}{more(bad)}.")
        return bad.size == 0


def component_names(feature: dict[str, Any]) -> list[str] | None:
    names = feature.get("names")
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    return list(names) if names else None


def component(feature: dict[str, Any], name: str, index: int) -> str:
    """How messages write one component: ``observation.state[vx]``."""
    names = component_names(feature)
    return f"{name}[{names[index] if names and index < len(names) else index}]"


def more(rows: np.ndarray) -> str:
    return f" (and {len(rows) - 1} more)" if len(rows) > 1 else ""
