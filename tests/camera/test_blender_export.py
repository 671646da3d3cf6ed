"""What is handed to Blender: the glTF holds the station, the poses are glTF cameras that see the same pixels."""

import ast
import json

import numpy as np
import pytest
import trimesh

from lerobot_spacedock.camera import CameraConfig, blender, project_points
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.station import station_for_port


def test_exported_scene_and_cameras(tmp_path):
    assert blender.main(["--out", str(tmp_path), "--detail", "low", "--distances_m", "10", "1"]) == 0
    mesh = station_for_port("zvezda_aft", "low")
    loaded = trimesh.load(tmp_path / "station.glb", force="mesh", process=False)
    assert len(loaded.faces) == len(mesh)
    turned = mesh.corners.reshape(-1, 3) @ blender.GLTF_FROM_HILL.T
    np.testing.assert_allclose(loaded.bounds, [turned.min(0), turned.max(0)], atol=1e-4)
    assert np.linalg.det(blender.GLTF_FROM_HILL) == pytest.approx(1.0)
    ast.parse((tmp_path / "render.py").read_text())
    job = json.loads((tmp_path / "poses.json").read_text())
    config = CameraConfig()
    points = np.array([[0.0, 0.0, 0.0], [0.7, 1.0, 0.2], [-0.3, 0.5, -0.6]])
    for frame, distance in zip(job["frames"], (10.0, 1.0), strict=True):
        view = np.linalg.inv(np.array(frame["camera_gltf"]))
        p = (points @ blender.GLTF_FROM_HILL.T) @ view[:3, :3].T + view[:3, 3]
        f = job["height"] / 2 / np.tan(np.radians(job["vfov_deg"]) / 2)  # glTF camera: looks along -z, y up
        u = job["width"] / 2 + f * p[:, 0] / -p[:, 2]
        v = job["height"] / 2 - f * p[:, 1] / -p[:, 2]
        expected = project_points(config, *port_pose("zvezda_aft", distance), points)
        np.testing.assert_allclose(np.stack([u, v, -p[:, 2]], -1), expected, atol=1e-6)
