"""A sheet of views for the eye: both ports from 25 m to 0.3 m, low Sun, eclipse, and places off the axis.

python -m lerobot_spacedock.camera.contact_sheet --out docs/images/contact_sheet.png
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from lerobot_spacedock.errors import InputError, SpaceDockError

from .config import BACKENDS, DETAILS, MAX_PIXELS_PER_SIDE, PORTS, CameraConfig, SensorConfig
from .renderer import make_renderer
from .sun import FIXED_SUN_H

LOW_SUN_H = {"zvezda_aft": np.array([-0.16, -0.40, 0.90]), "harmony_forward": np.array([-0.16, 0.40, 0.90])}
MIN_WIDTH = 64  # pixels of a picture; less leaves no room for its caption
ECLIPSE_SUN_H = np.array([-0.95, 0.2, 0.25])


def port_pose(port: str, distance_m: float, *, up_m: float = 0.0, side_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A camera ``distance_m`` in front of a port that looks along its axis, or at it when moved up or aside.

    Returns:
        Position (3,) m in Hill axes and attitude (4,), scalar first, body to Hill; zenith is up in the picture.
    """
    sign = -1.0 if port == "zvezda_aft" else 1.0
    r = np.array([up_m, sign * distance_m, side_m])
    forward = -r / np.linalg.norm(r)
    up = np.array([1.0, 0.0, 0.0]) - forward * forward[0]
    x = up / np.linalg.norm(up)  # body x is up in the picture, z the view
    dcm = np.stack([x, np.cross(forward, x), forward], -1)
    return r, _quaternion(dcm)


def _quaternion(dcm: np.ndarray) -> np.ndarray:
    """Rotation matrix → scalar-first quaternion, by its largest part."""
    m = dcm
    four = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                     1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])  # fmt: skip
    k = int(four.argmax())
    s = 0.5 * math.sqrt(four[k])
    w, x, y = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    a, b, c = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    parts = ([4 * s * s, w, x, y], [w, 4 * s * s, a, b], [x, a, 4 * s * s, c], [y, b, c, 4 * s * s])[k]
    q = np.array(parts, float) / (4 * s)
    return q / np.linalg.norm(q)


def views() -> list[tuple[str, str, np.ndarray, np.ndarray, np.ndarray, SensorConfig]]:
    """Caption, port, position, attitude, Sun and sensor of each picture."""
    clean, out = SensorConfig(), []
    for port, name in (("zvezda_aft", "Zvezda aft"), ("harmony_forward", "Harmony forward")):
        for d in (25.0, 10.0, 3.0, 1.0, 0.3):
            out.append((f"{name}, {d:g} m", port, *port_pose(port, d), FIXED_SUN_H[port], clean))
    for port in PORTS:
        out.append(("low Sun, 10 m", port, *port_pose(port, 10.0), LOW_SUN_H[port], clean))
        out.append(("eclipse, docking lamp, 3 m", port, *port_pose(port, 3.0), ECLIPSE_SUN_H, clean))
    out.append(("from above and aside, 40 m", "zvezda_aft", *port_pose("zvezda_aft", 32.0, up_m=16.0, side_m=18.0),
                FIXED_SUN_H["zvezda_aft"], clean))  # fmt: skip
    out.append(("15 degrees off the axis, 2 m", "zvezda_aft", *port_pose("zvezda_aft", 1.93, side_m=-0.52),
                FIXED_SUN_H["zvezda_aft"], clean))  # fmt: skip
    out.append(("15 degrees off the axis, 2 m", "harmony_forward", *port_pose("harmony_forward", 1.93, up_m=0.52),
                FIXED_SUN_H["harmony_forward"], clean))  # fmt: skip
    out.append(("alongside Zvezda, 12 m", "zvezda_aft", *port_pose("zvezda_aft", 6.0, up_m=4.0, side_m=9.0),
                FIXED_SUN_H["zvezda_aft"], clean))  # fmt: skip
    out.append(("from below, 40 m", "harmony_forward", *port_pose("harmony_forward", 30.0, up_m=-12.0, side_m=-22.0),
                FIXED_SUN_H["harmony_forward"], clean))  # fmt: skip
    worn = SensorConfig(read_noise=0.004, full_well_electrons=12000, blur_px=0.7, distortion_k1=-0.15, bloom=0.25)
    out.append(
        (
            "noise, blur, barrel, bloom, 10 m",
            "zvezda_aft",
            *port_pose("zvezda_aft", 10.0),
            FIXED_SUN_H["zvezda_aft"],
            worn,
        )
    )
    return out


def make_sheet(path: str | Path, *, detail: str = "high", backend: str = "software", width: int = 320) -> Path:
    """Draw every view and write them as one PNG."""
    from PIL import Image, ImageDraw

    shots = views()
    columns, height = 5, width * 3 // 4
    rows = math.ceil(len(shots) / columns)
    sheet = Image.new("RGB", (columns * (width + 4) + 4, rows * (height + 22) + 4), (18, 20, 24))
    pen = ImageDraw.Draw(sheet)
    renderers = {}
    for k, (caption, port, r_H, q_HB, sun_H, sensor) in enumerate(shots):
        config = CameraConfig(height=height, width=width, port=port, detail=detail, sensor=sensor)
        if config not in renderers:
            renderers[config] = make_renderer(config, backend=backend)
        x, y = 4 + (k % columns) * (width + 4), 4 + (k // columns) * (height + 22)
        sheet.paste(Image.fromarray(renderers[config].render(r_H, q_HB, sun_H)), (x, y))
        pen.text((x + 3, y + height + 4), caption, fill=(205, 210, 218))
    for renderer in renderers.values():
        renderer.close()
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)  # a third of the size, for the documents
    return path


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", default="contact_sheet.png", help="PNG to write")
    parser.add_argument("--detail", choices=DETAILS, default="high", help="level of detail of the station")
    parser.add_argument("--backend", choices=BACKENDS, default="software", help="renderer")
    parser.add_argument("--width", type=int, default=320, help="width of each picture, pixels")
    options = parser.parse_args(arguments)
    if not MIN_WIDTH <= options.width <= MAX_PIXELS_PER_SIDE:
        raise InputError("--width", options.width, f"a whole number from {MIN_WIDTH} to {MAX_PIXELS_PER_SIDE}")
    print("wrote", make_sheet(options.out, detail=options.detail, backend=options.backend, width=options.width))
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except SpaceDockError as error:
        raise SystemExit(f"error: {error}") from None
