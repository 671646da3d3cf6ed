"""What a camera is and what it may do: plain frozen data, no renderer loaded."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot_spacedock.errors import InputError, in_range, one_of

PORTS = ("zvezda_aft", "harmony_forward")
BACKENDS = ("software", "pyrender")
DETAILS = ("low", "high")
MAX_PIXELS_PER_SIDE = 8192


@dataclass(frozen=True)
class SensorConfig:
    """Optional faults of a real camera. All zero (the default) is a perfect sensor."""

    read_noise: float = 0.0
    """Standard deviation of the read noise, as a share of full scale (0.005 is a fair space camera)."""
    full_well_electrons: float = 0.0
    """Electrons at full scale, for shot noise; 0 switches shot noise off (20,000 is typical)."""
    blur_px: float = 0.0
    """Standard deviation of the optics' blur, pixels."""
    distortion_k1: float = 0.0
    """Radial distortion, r_d = r (1 + k1 r² + k2 r⁴) in tangent units; negative is a barrel."""
    distortion_k2: float = 0.0
    """Second radial distortion coefficient."""
    bloom: float = 0.0
    """Share of the light above bloom_threshold that is spread around."""
    bloom_px: float = 6.0
    """Width of the bloom, pixels."""
    bloom_threshold: float = 0.8
    """Linear level, 0 to 1, above which light blooms."""
    seed: int = 0
    """Seed of the noise, beside the episode's; a generator passed to render() takes its place."""

    def __post_init__(self) -> None:
        for name in ("read_noise", "full_well_electrons", "blur_px", "bloom", "bloom_px", "bloom_threshold"):
            in_range(f"camera.sensor.{name}", getattr(self, name), 0.0, 1e7)
        for name in ("distortion_k1", "distortion_k2"):
            in_range(f"camera.sensor.{name}", getattr(self, name), -1.0, 1.0)
        if not isinstance(self.seed, int) or self.seed < 0:
            raise InputError("camera.sensor.seed", self.seed, "a whole number, 0 or more")

    @property
    def noisy(self) -> bool:
        """Whether a frame holds noise."""
        return self.read_noise > 0.0 or self.full_well_electrons > 0.0

    @property
    def active(self) -> bool:
        """Whether any fault is switched on."""
        faults = (
            self.read_noise,
            self.full_well_electrons,
            self.blur_px,
            self.distortion_k1,
            self.distortion_k2,
            self.bloom,
        )
        return any(faults)


@dataclass(frozen=True)
class CameraConfig:
    """A pinhole camera at the chaser's reference point that looks along body +z, and the scene it sees."""

    height: int = 480
    """Rows of the picture, pixels."""
    width: int = 640
    """Columns of the picture, pixels."""
    vfov_deg: float = 60.0
    """Vertical field of view, degrees; pixels are square, so the width follows."""
    near_m: float = 0.05
    """Nothing nearer than this is drawn, m."""
    far_m: float = 400.0
    """Depth of a pixel that shows the sky, m; the station should lie within it: what does not, pyrender leaves out."""
    port: str = "zvezda_aft"
    """Docking port at the origin of the Hill frame: zvezda_aft (seen from -V-bar) or harmony_forward (from +V-bar)."""
    detail: str = "low"
    """Level of detail of the built-in station: low (about 35,000 triangles) or high (about 110,000)."""
    samples: int = 4
    """Samples a pixel of the software renderer: 4 (rotated grid) or 1 (no anti-aliasing); pyrender has its own."""
    shadows: bool = True
    """Hard shadows from the Sun."""
    exposure: float = 0.0
    """Gain on the light that reaches the film; 0 chooses one gain in sunlight and another in eclipse."""
    lamp: str = "auto"
    """Docking lamp: auto (on in eclipse), on, off."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """Noise, blur, distortion, bloom."""

    def __post_init__(self) -> None:
        for name in ("height", "width"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MAX_PIXELS_PER_SIDE:
                raise InputError(f"camera.{name}", value, f"a whole number from 1 to {MAX_PIXELS_PER_SIDE}")
        in_range("camera.vfov_deg", self.vfov_deg, 1.0, 150.0)
        in_range("camera.near_m", self.near_m, 1e-3, 10.0)
        in_range("camera.far_m", self.far_m, 10.0 + self.near_m, 1e6)
        in_range("camera.exposure", self.exposure, 0.0, 1e6)
        one_of("camera.port", self.port, PORTS)
        one_of("camera.detail", self.detail, DETAILS)
        if str(self.lamp) in ("True", "False"):  # what YAML makes of on and off
            object.__setattr__(self, "lamp", "on" if str(self.lamp) == "True" else "off")
        one_of("camera.lamp", self.lamp, ("auto", "on", "off"))
        if self.samples not in (1, 4):
            raise InputError("camera.samples", self.samples, "1 or 4")
