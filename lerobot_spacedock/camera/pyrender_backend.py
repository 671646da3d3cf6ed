"""The second backend: pyrender over OpenGL (EGL on a GPU or llvmpipe, else OSMesa), the same station, Sun and camera.

It is the independent witness of the software renderer: another rasteriser, other shading code. All OpenGL work runs
on one thread of the process, because EGL contexts belong to a thread and deleting one of pyrender's renderers breaks
the others.
"""

from __future__ import annotations

import ctypes.util
import os
import sys
import types
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from lerobot_spacedock.errors import MissingDependencyError, SimulationError
from lerobot_spacedock.station import MATERIALS, PATTERNS
from lerobot_spacedock.station.materials import srgb_bytes

from .config import CameraConfig
from .exposure import light_array
from .pinhole import checked_pose, checked_sun, intrinsics, rotation_CH
from .renderer import Buffers
from .sensor import Sensor
from .shared import compiling_notice, earth_texels, pattern_texels, shared_scene, star_table

HEADROOM = 3.0  # light is drawn this much dimmer, so that pyrender's clamp leaves the highlights to the film curve
SHADOW_REACH_m = 12.0  # half width of pyrender's one shadow map: outside of it nothing is in shadow
GL_CLAMP_TO_BORDER = 0x812D  # of OpenGL; glTF, whose names pyrender has, knows none
_HELP = (
    "On Debian or Ubuntu: apt install libegl1 libgl1 (EGL) or libosmesa6 (OSMesa, with PYOPENGL_PLATFORM=osmesa); "
    "or use the software renderer, which needs no GL library"
)


class PyrenderRenderer:
    """Draws views with pyrender. Any thread may call it; a forked child of a process that has drawn may not."""

    def __init__(self, config: CameraConfig, station_mesh=None, station_pose=None) -> None:
        self.config = config
        _import_pyrender()
        with compiling_notice("scene"):
            self._scene = shared_scene(config.port, config.detail, station_mesh, station_pose)
        self._sensor = Sensor(config) if config.sensor.active else None
        self._pad = self._sensor.pad if self._sensor else (0, 0)
        _on_gl_thread(_stage_for, self._scene)

    def render(self, r_H, q_HB, sun_H, *, generator=None) -> np.ndarray:
        """See :class:`lerobot_spacedock.camera.Renderer`."""
        return self._draw(r_H, q_HB, sun_H, generator)[0]

    def render_buffers(self, r_H, q_HB, sun_H, *, generator=None) -> Buffers:
        """See :class:`lerobot_spacedock.camera.Renderer`."""
        image, depth = self._draw(r_H, q_HB, sun_H, generator)
        r, q = checked_pose(r_H, q_HB)
        config = self.config
        segment = _on_gl_thread(_draw_segments, self._scene, config, r, rotation_CH(q))
        rows, columns = self._pad
        depth = depth[rows : rows + config.height, columns : columns + config.width]
        depth = np.where(depth > 0, depth, np.float32(config.far_m)).astype(np.float32)
        return Buffers(image, depth, segment)

    def close(self) -> None:
        """Let go of the scene; the process's one OpenGL context stays for the other renderers."""
        self._scene = None

    def _draw(self, r_H, q_HB, sun_H, generator):
        if self._scene is None:
            raise SimulationError("this renderer is closed; make another with make_renderer()")
        r, q = checked_pose(r_H, q_HB)
        sun, rot, config = checked_sun(sun_H), rotation_CH(q), self.config
        light, star_gain = light_array(config, r, sun)
        rgba, depth = _on_gl_thread(_draw_colour, self._scene, config, self._pad, r, rot, light)
        linear = _film(rgba[..., :3], light[15])
        clear = np.float32(1.0) - rgba[..., 3].astype(np.float32) / np.float32(255.0)
        linear = _with_sky(linear, clear, config, self._pad, rot, light, star_gain)
        if self._sensor:
            return self._sensor.expose(linear, generator), depth
        return _encode(linear), depth


def _film(rgb: np.ndarray, exposure: float) -> np.ndarray:
    """pyrender's bytes → the film curve's linear 0..1."""
    x = (rgb.astype(np.float32) / np.float32(255.0)) ** np.float32(2.2) * np.float32(HEADROOM * exposure)
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def _with_sky(linear, clear, config: CameraConfig, pad, rot, light, star_gain) -> np.ndarray:
    from .kernels_sky import paint_sky, paint_stars, project_stars

    height, width = clear.shape
    k = intrinsics(config)
    view = np.array([k[0, 0], k[1, 1], k[0, 2] + pad[1], k[1, 2] + pad[0], config.near_m])
    colour = np.ascontiguousarray(linear, np.float32).reshape(-1)
    flat = np.ascontiguousarray(clear, np.float32).reshape(-1)
    paint_sky(0, height, width, flat, rot, view, light, earth_texels(), colour)
    if star_gain > 0.0:
        found = np.empty((len(star_table()), 5))
        n = project_stars(star_table(), rot, view, width, height, found)
        paint_stars(found, n, 0, height, width, flat, star_gain, colour)
    return colour.reshape(height, width, 3)


def _encode(linear: np.ndarray) -> np.ndarray:
    from .kernels_shade import encode

    out = np.empty(linear.shape, np.uint8)
    encode(np.ascontiguousarray(linear, np.float32).reshape(-1), linear.size, out.reshape(-1), 0)
    return out


# --- the OpenGL side: everything below runs on the process's one OpenGL thread ---

_gl = types.SimpleNamespace(pool=None, pid=None, offscreen=None, stages={})


def _on_gl_thread(work, *args):
    if _gl.pid is None:
        _gl.pool, _gl.pid = ThreadPoolExecutor(1, "spacedock-gl"), os.getpid()
    if _gl.pid != os.getpid():
        raise SimulationError(
            "the pyrender backend cannot draw in a forked child of a process that has drawn: "
            "OpenGL does not survive fork. "
            "Use forkserver or spawn workers, or the software renderer"
        )
    return _gl.pool.submit(work, *args).result()


def _import_pyrender():
    """pyrender, headless; or a MissingDependencyError that says what to install."""
    if "pyrender" in sys.modules:
        return sys.modules["pyrender"]
    if "PYOPENGL_PLATFORM" not in os.environ:
        os.environ["PYOPENGL_PLATFORM"] = "egl" if ctypes.util.find_library("EGL") else "osmesa"
    if not ctypes.util.find_library("EGL") and not ctypes.util.find_library("OSMesa"):
        raise MissingDependencyError(f"the pyrender backend needs OpenGL libraries, and there are none. {_HELP}")
    # pyrender's viewer opens an X11 window library on import; nothing here needs it
    stub = types.ModuleType("pyrender.viewer")
    stub.Viewer = None
    sys.modules.setdefault("pyrender.viewer", stub)
    try:
        import pyrender
    except ImportError as error:
        sys.modules.pop("pyrender.viewer", None)
        raise MissingDependencyError(
            f"the pyrender backend needs pyrender ({error}): pip install '.[pyrender]' in SpaceDock's folder. {_HELP}"
        ) from error
    except Exception as error:  # PyOpenGL raises its own kinds when a library is missing
        raise MissingDependencyError(f"the pyrender backend cannot load OpenGL ({error}). {_HELP}") from error
    return pyrender


def _offscreen(width: int, height: int):
    import pyrender

    if _gl.offscreen is None:
        try:
            _gl.offscreen = pyrender.OffscreenRenderer(width, height)
        except Exception as error:
            raise MissingDependencyError(
                f"the pyrender backend cannot open an OpenGL context ({type(error).__name__}: {error}). {_HELP}"
            ) from error
    _gl.offscreen.viewport_width, _gl.offscreen.viewport_height = width, height
    return _gl.offscreen


def _stage_for(scene):
    """The pyrender scene of a station: one primitive a material; lights and camera to be posed for each frame."""
    if id(scene) in _gl.stages:
        return _gl.stages[id(scene)][1]
    import pyrender

    class SunLight(pyrender.DirectionalLight):
        """A Sun whose one shadow map is spent on the neighbourhood of the port."""

        def _generate_shadow_texture(self, size=None):
            super()._generate_shadow_texture(size)  # which repeats itself beyond its edge, all over the station
            self.shadow_texture.sampler = pyrender.Sampler(wrapS=GL_CLAMP_TO_BORDER, wrapT=GL_CLAMP_TO_BORDER)

        def _get_shadow_camera(self, scene_scale):
            return PortCamera(znear=0.3 * scene_scale, zfar=1.7 * scene_scale, xmag=SHADOW_REACH_m, ymag=SHADOW_REACH_m)

    class PortCamera(pyrender.OrthographicCamera):
        """pyrender aims at the middle of the scene; this looks past it, at the port (the origin)."""

        def get_projection_matrix(self, width=None, height=None):
            projection = super().get_projection_matrix(width, height)
            node = parts.sun
            middle = node.matrix[:3, :3].T @ stage.centroid
            projection[0, 3] += projection[0, 0] * middle[0]
            projection[1, 3] += projection[1, 1] * middle[1]
            return projection

    mesh = scene.load_mesh()
    stage = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0], ambient_light=[0.0, 0.0, 0.0])
    stage.add(pyrender.Mesh(primitives=[p for p in (_primitive(mesh, m) for m in range(len(MATERIALS))) if p]))
    ids = {}
    segments = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    for s in np.unique(mesh.segment):
        part = mesh.segment == s
        node = segments.add(pyrender.Mesh(primitives=[_bare(mesh.corners[part], mesh.two_sided[part].any())]))
        ids[node] = int(s)
    parts = types.SimpleNamespace(
        stage=stage,
        segments=segments,
        ids=ids,
        sun=stage.add(SunLight(color=[1.0, 1.0, 1.0], intensity=1.0)),
        earth=stage.add(
            pyrender.DirectionalLight(color=[1.0, 1.0, 1.0], intensity=1.0), pose=_looking(np.array([1.0, 0, 0]))
        ),
        lamp=stage.add(pyrender.PointLight(color=[1.0, 1.0, 1.0], intensity=0.0)),
        camera=None,
        segment_camera=None,
    )
    _gl.stages[id(scene)] = (scene, parts)  # the scene is held, so that its id stays its own
    return parts


def _bare(corners: np.ndarray, both: bool):
    import pyrender

    material = pyrender.MetallicRoughnessMaterial(doubleSided=bool(both))
    return pyrender.Primitive(positions=corners.reshape(-1, 3).astype(np.float32), material=material, mode=4)


def _primitive(mesh, index: int):
    import pyrender

    part = mesh.material == index
    if not part.any():
        return None
    m = MATERIALS[index]
    texture, uv = None, None
    if m.tile_m:
        texture = pyrender.Texture(source=_tile(m), source_channels="RGB")
        uv = (mesh.uvs[part].reshape(-1, 2) / m.tile_m).astype(np.float32)
    material = pyrender.MetallicRoughnessMaterial(
        baseColorFactor=[1.0, 1.0, 1.0, 1.0] if texture else [*m.base, 1.0],
        baseColorTexture=texture,
        roughnessFactor=float(m.rough),
        metallicFactor=float(m.metal),
        emissiveFactor=[float(m.glow * c) for c in m.base],
        doubleSided=bool(mesh.two_sided[part].any()),
    )
    return pyrender.Primitive(
        positions=mesh.corners[part].reshape(-1, 3).astype(np.float32),
        normals=mesh.normals[part].reshape(-1, 3).astype(np.float32),
        texcoord_0=uv,
        material=material,
        mode=4,
    )


def _tile(material) -> np.ndarray:
    """A material's pattern in its colours, (256, 256, 3) uint8 sRGB."""
    from .kernels_resolve import PATTERN_TEXELS, TILE

    start = PATTERNS.index(material.pattern) * PATTERN_TEXELS + TILE * (TILE + 1)
    word = pattern_texels()[start : start + TILE * (TILE + 1)].reshape(TILE, TILE + 1)[:, :TILE]
    tint = 1.0 + material.tint * ((word & 255) / 127.5 - 1.0)
    share = ((word >> 8) & 255)[..., None] / 255.0
    linear = (np.array(material.base) * (1 - share) + np.array(material.second) * share) * tint[..., None]
    return srgb_bytes(linear)


def _looking(direction: np.ndarray) -> np.ndarray:
    """Pose of a light that shines along ``direction``."""
    z = -direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = x, np.cross(z, x), z
    return pose


def _camera_pose(r: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """OpenGL cameras look along -z with y up."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = rot[0], -rot[1], -rot[2], r
    return pose


def _place_camera(stage, node, config: CameraConfig, pad, r, rot):
    import pyrender

    if node is not None:
        stage.remove_node(node)
    k = intrinsics(config)
    camera = pyrender.IntrinsicsCamera(
        fx=k[0, 0], fy=k[1, 1], cx=k[0, 2] + pad[1], cy=k[1, 2] + pad[0], znear=config.near_m, zfar=config.far_m
    )
    node = stage.add(camera, pose=_camera_pose(r, rot))
    stage.main_camera_node = node
    return node


def _draw_colour(scene, config: CameraConfig, pad, r, rot, light):
    import pyrender

    parts = _stage_for(scene)
    parts.camera = _place_camera(parts.stage, parts.camera, config, pad, r, rot)
    pi = float(np.pi) / HEADROOM  # the light array's unit is the radiance of a white card
    level = float(max(light[3:6].max(), 1e-9))
    parts.sun.light.color, parts.sun.light.intensity = light[3:6] / level, level * pi
    parts.stage.set_pose(parts.sun, _looking(-light[0:3].astype(float)))
    # half a sphere of Earth: a part from straight below, the rest from all around
    level = float(max(light[6:9].max(), 1e-9))
    parts.earth.light.color, parts.earth.light.intensity = light[6:9] / level, 0.5 * level * pi
    parts.stage.ambient_light = (0.3 * light[6:9] + light[9:12]) / HEADROOM
    lamp = float(light[12:15].max())
    parts.lamp.light.color = light[12:15] / max(lamp, 1e-9)
    parts.lamp.light.intensity = lamp * pi
    pose = np.eye(4)
    pose[:3, 3] = r - rot[2] * np.sqrt(float(light[16]))
    parts.stage.set_pose(parts.lamp, pose)
    flags = pyrender.RenderFlags.RGBA
    if config.shadows and light[3] > 0.0:
        flags |= pyrender.RenderFlags.SHADOWS_DIRECTIONAL
        parts.earth.light.intensity = 0.0  # pyrender would draw it a shadow map of its own
        parts.stage.ambient_light = (0.5 * light[6:9] + light[9:12]) / HEADROOM
    return _offscreen(config.width + 2 * pad[1], config.height + 2 * pad[0]).render(parts.stage, flags=flags)


def _draw_segments(scene, config: CameraConfig, r, rot) -> np.ndarray:
    import pyrender

    parts = _stage_for(scene)
    parts.segment_camera = _place_camera(parts.segments, parts.segment_camera, config, (0, 0), r, rot)
    image, _ = _offscreen(config.width, config.height).render(
        parts.segments, flags=pyrender.RenderFlags.SEG, seg_node_map=parts.ids
    )
    return np.ascontiguousarray(image[..., 0])
