"""One row of the benchmarks' table: what was measured, beside a named peer or floor of the same run."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A measurement and what it is set beside.

    Attributes:
        what: what was measured.
        value, unit: the measurement.
        peer: what it is compared with, measured in the same run; empty if there is none.
        peer_value: the peer's, same unit.
    """

    what: str
    value: float
    unit: str
    peer: str = ""
    peer_value: float | None = None


def machine() -> str:
    """The machine and how busy it is, for the line above a table."""
    return f"{platform.machine()}, {os.cpu_count()} CPUs, load average {os.getloadavg()[0]:.1f}"


def show(rows: Iterable[Row]) -> None:
    """Prints a Markdown table, row by row as they come."""
    print(f"machine: {machine()}\n\n| what | measured | beside | measured | ratio |\n|---|---|---|---|---|", flush=True)
    for row in rows:
        print(line(row), flush=True)


def line(row: Row) -> str:
    """The row in Markdown."""
    cells = [row.what, f"{number(row.value)} {row.unit}"]
    if row.peer_value is None:
        return "| " + " | ".join([*cells, row.peer, "", ""]) + " |"
    ratio = row.value / row.peer_value if row.peer_value else float("nan")
    return "| " + " | ".join([*cells, row.peer, f"{number(row.peer_value)} {row.unit}", f"{ratio:.2g}"]) + " |"


def number(value: float) -> str:
    """Three digits, large ones with thousands separators."""
    return f"{float(f'{value:.3g}'):,.0f}" if abs(value) >= 100 else f"{value:.3g}"
