"""The instrument overlay of an approach's pictures: range, rate, misalignment, and whether they lie in the box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from lerobot_spacedock.physics.contact import IDSS, Port, box_conditions

GOOD, OUT, PLAIN, DIM = (86, 211, 160), (255, 176, 92), (240, 243, 248), (170, 178, 190)


@dataclass(frozen=True)
class Reading:
    """One instrument: what it shows, and whether the value lies in the IDSS box (None: the box does not limit it)."""

    name: str
    value: str
    unit: str
    inside: bool | None


def readings(contact: dict[str, np.ndarray], range_m: float) -> tuple[Reading, ...]:
    """The instruments for a state as ``physics.contact.contact_state`` gives it (scalars)."""
    c = {name: float(value) for name, value in contact.items()}
    passed = {name: bool(value) for name, value in box_conditions(contact, IDSS).items()}
    return (
        Reading("RANGE", f"{range_m:.2f}", "m", None),
        Reading("CLOSING", f"{c['closing_speed_m_s']:+.3f}", "m/s", passed["closing_speed"]),
        Reading("LATERAL", f"{c['lateral_m']:.3f}", "m", passed["lateral"]),
        Reading("LAT RATE", f"{c['lateral_speed_m_s']:.3f}", "m/s", passed["lateral_speed"]),
        Reading("PITCH/YAW", f"{c['pitch_yaw_deg']:.2f}", "°", passed["pitch_yaw"]),
        Reading("ROLL", f"{c['roll_deg']:+.2f}", "°", passed["roll"]),
    )


def overlay(frame: np.ndarray, instruments: tuple[Reading, ...], *, time_s: float, caption: str = "") -> np.ndarray:
    """The picture with a band of instruments below it and a reticle on its axis.

    Args:
        frame: uint8 (H, W, 3).
        instruments: left to right; as many as fit are drawn.
        time_s: s since the start.
        caption: upper left corner.

    Returns:
        uint8 (H + band, W, 3), both even, as video encoders want them.
    """
    height, width = frame.shape[:2]
    unit = max(9, round(width / 53))
    band = int(3.4 * unit)
    canvas = Image.new("RGB", (width + width % 2, height + band + (height + band) % 2), (13, 16, 22))
    canvas.paste(Image.fromarray(frame), (0, 0))
    draw = ImageDraw.Draw(canvas, "RGBA")
    _reticle(draw, width / 2, height / 2, unit)
    small, large = _font(int(0.82 * unit)), _font(int(1.25 * unit))
    shown = instruments[: max(1, min(len(instruments), width // (6 * unit)))]
    cell = width / len(shown)
    for i, reading in enumerate(shown):
        x = i * cell + 0.5 * unit
        colour = PLAIN if reading.inside is None else (GOOD if reading.inside else OUT)
        mark = "" if reading.inside is None else (" ●" if reading.inside else " ○")  # told apart without colour too
        draw.text((x, height + 0.35 * unit), reading.name + mark, font=small, fill=DIM)
        draw.text((x, height + 1.4 * unit), reading.value, font=large, fill=colour)
        draw.text((x + large.getlength(reading.value + " "), height + 1.75 * unit), reading.unit, font=small, fill=DIM)
    clock = f"T+{time_s:5.1f} s"
    if small.getlength(caption + clock) + 2.0 * unit < width:  # on a narrow picture the clock goes first
        _label(draw, (0.6 * unit, 0.5 * unit), caption, small)
    _label(draw, (width - small.getlength(clock) - 0.6 * unit, 0.5 * unit), clock, small)
    return np.asarray(canvas)


def frame_readings(state: np.ndarray, port: Port, *, hill_coupling: bool) -> tuple[Reading, ...]:
    """The instruments for one SI state, (14,)."""
    from lerobot_spacedock.physics.contact import contact_state

    return readings(contact_state(state, port, hill_coupling=hill_coupling), float(np.linalg.norm(state[:3])))


def _reticle(draw: ImageDraw.ImageDraw, x: float, y: float, unit: int) -> None:
    inner, outer = 0.7 * unit, 2.2 * unit
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        ends = (x + dx * inner, y + dy * inner, x + dx * outer, y + dy * outer)
        draw.line(ends, fill=(0, 0, 0, 110), width=4)
        draw.line(ends, fill=(*GOOD, 210), width=2)


def _label(draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, font: ImageFont.FreeTypeFont) -> None:
    draw.text(at, text, font=font, fill=PLAIN, stroke_width=2, stroke_fill=(0, 0, 0, 160))


@lru_cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    import matplotlib  # it ships the typeface; nothing of it is run

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSansMono.ttf"), size)
