"""Render exported poses with Cycles. Runs inside Blender, beside station.glb and poses.json:

blender --background --python render.py [-- --samples 64]
"""

import json
import math
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SUN_ANGLE_rad = math.radians(0.533)  # the disc's diameter, for soft edges of shadows
SUN_STRENGTH_W_m2 = 5.0  # Blender's unit; with the Filmic or AgX view a white card is then just below white


def argument(name: str, default: int) -> int:
    """A whole number after ``--`` on Blender's command line."""
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    return int(own[own.index(name) + 1]) if name in own else default


def main() -> None:
    """Load the scene, then one picture a pose."""
    import bpy
    from mathutils import Matrix, Vector

    # Blender's importer turns glTF's y up into z up
    blender_from_gltf = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    job = json.loads((FOLDER / "poses.json").read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(FOLDER / "station.glb"))
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = argument("--samples", 64)
    scene.cycles.use_denoising = True
    scene.render.resolution_x, scene.render.resolution_y = job["width"], job["height"]
    scene.render.resolution_percentage = 100
    world = bpy.data.worlds.new("space")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.data.sensor_fit = "VERTICAL"
    camera.data.angle_y = math.radians(job["vfov_deg"])
    camera.data.clip_start, camera.data.clip_end = job["near_m"], job["far_m"]
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle = SUN_STRENGTH_W_m2, SUN_ANGLE_rad
    scene.collection.objects.link(sun)
    earth = bpy.data.objects.new("earthshine", bpy.data.lights.new("earthshine", "SUN"))
    earth.data.energy, earth.data.angle, earth.data.color = 0.6, math.pi, (0.6, 0.75, 1.0)
    earth.rotation_euler = (math.pi, 0.0, 0.0)  # shines upwards
    scene.collection.objects.link(earth)
    for frame in job["frames"]:
        camera.matrix_world = blender_from_gltf @ Matrix(frame["camera_gltf"])
        to_sun = blender_from_gltf.to_3x3() @ Vector(frame["to_sun_gltf"])
        sun.rotation_euler = to_sun.to_track_quat("Z", "Y").to_euler()
        scene.render.filepath = str(FOLDER / f"{frame['name']}.png")
        bpy.ops.render.render(write_still=True)
        print("wrote", scene.render.filepath)


if __name__ == "__main__":
    main()
