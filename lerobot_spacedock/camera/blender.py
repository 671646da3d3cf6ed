"""The scene for Blender: a glTF of the station, poses as JSON, and the script that renders them with Cycles.

    python -m lerobot_spacedock.camera.blender --out scene # writes station.glb, poses.json, render.py
    blender --background --python scene/render.py          # a user's Blender, 4.2 or later

The files hold Hill axes turned into glTF's (y up: glTF y = Hill x, zenith). No Blender can be installed for Python
3.12, so the script is checked for its syntax and for the geometry that it reads, but has not been run in Blender
itself.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.station import MATERIALS, SEGMENTS, StationMesh, station_for_port

from .config import DETAILS, PORTS, CameraConfig
from .contact_sheet import port_pose
from .pinhole import checked_pose, checked_sun, rotation_CH
from .sun import FIXED_SUN_H

# glTF: +y up, right-handed. Hill x (zenith) → y, Hill y (along-track) → -z, Hill z (orbit normal) → -x
GLTF_FROM_HILL = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def export_station(path: str | Path, mesh: StationMesh) -> Path:
    """Write the station as glTF (``.glb``): one node a segment and material, Hill axes turned into glTF's."""
    import trimesh
    from trimesh.visual.material import PBRMaterial

    path = Path(path)
    scene = trimesh.Scene()
    corners, normals = mesh.corners @ GLTF_FROM_HILL.T, mesh.normals @ GLTF_FROM_HILL.T
    for segment in np.unique(mesh.segment):
        for kind in np.unique(mesh.material[mesh.segment == segment]):
            part = (mesh.segment == segment) & (mesh.material == kind)
            m = MATERIALS[kind]
            n = int(part.sum())
            surface = PBRMaterial(
                name=m.name,
                baseColorFactor=[*_linear_bytes(m.base), 255],
                metallicFactor=m.metal,
                roughnessFactor=m.rough,
                doubleSided=bool(mesh.two_sided[part].any()),
            )
            piece = trimesh.Trimesh(
                vertices=corners[part].reshape(-1, 3),
                faces=np.arange(3 * n).reshape(-1, 3),
                vertex_normals=normals[part].reshape(-1, 3),
                visual=trimesh.visual.TextureVisuals(uv=mesh.uvs[part].reshape(-1, 2), material=surface),
                process=False,
            )
            scene.add_geometry(
                piece, node_name=f"{SEGMENTS[segment]}.{m.name}", geom_name=f"{SEGMENTS[segment]}.{m.name}"
            )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(scene.export(file_type="glb", include_normals=True))
    return path


def export_poses(path: str | Path, config: CameraConfig, views: list[tuple]) -> Path:
    """Write views as JSON: for each, the (4, 4) pose of a glTF camera (looks along -z, y up) and the Sun's direction.

    Args:
        path: file to write.
        config: picture size and field of view.
        views: (name, r_H, q_HB, sun_H) each.
    """
    frames = []
    for name, r_H, q_HB, sun_H in views:
        r, q = checked_pose(r_H, q_HB)
        rot = rotation_CH(q)
        pose = np.eye(4)
        pose[:3, :3] = GLTF_FROM_HILL @ np.stack([rot[0], -rot[1], -rot[2]], -1)
        pose[:3, 3] = GLTF_FROM_HILL @ r
        sun = GLTF_FROM_HILL @ checked_sun(sun_H)
        frames.append({"name": str(name), "camera_gltf": pose.tolist(), "to_sun_gltf": sun.tolist()})
    content = {
        "width": config.width,
        "height": config.height,
        "vfov_deg": config.vfov_deg,
        "near_m": config.near_m,
        "far_m": config.far_m,
        "frames": frames,
    }
    Path(path).write_text(json.dumps(content, indent=1))
    return Path(path)


def main(arguments: list[str] | None = None) -> int:
    """Write everything that Blender needs into one folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", required=True, help="folder to write")
    parser.add_argument("--port", choices=PORTS, default=PORTS[0], help="docking port at the origin")
    parser.add_argument("--detail", choices=DETAILS, default="high", help="level of detail")
    parser.add_argument(
        "--distances_m", type=float, nargs="+", default=[25.0, 10.0, 3.0, 1.0, 0.3], help="poses on the axis, m"
    )
    options = parser.parse_args(arguments)
    if min(options.distances_m) <= 0:
        raise InputError("--distances_m", options.distances_m, "positive numbers, metres")
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    export_station(folder / "station.glb", station_for_port(options.port, options.detail))
    views = [(f"{d:g}m", *port_pose(options.port, d), FIXED_SUN_H[options.port]) for d in options.distances_m]
    export_poses(folder / "poses.json", CameraConfig(port=options.port), views)
    script = Path(__file__).with_name("blender_render.py").read_text()
    (folder / "render.py").write_text(script)
    print(
        f"Wrote {folder}/station.glb, poses.json and render.py. Next: blender --background --python {folder}/render.py"
    )
    return 0


def _linear_bytes(linear) -> list[int]:
    """trimesh keeps glTF's base colour as bytes; glTF itself is linear, so these are the linear values in bytes."""
    return [round(255 * min(max(c, 0.0), 1.0)) for c in linear]


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except SpaceDockError as error:
        raise SystemExit(f"error: {error}") from None
