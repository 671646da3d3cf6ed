"""The procedural International Space Station as triangles and materials; no renderer in it."""

from .materials import MATERIALS, PATTERNS
from .mesh import SEGMENTS, StationMesh, load_station, station_for_port

__all__ = ["MATERIALS", "PATTERNS", "SEGMENTS", "StationMesh", "load_station", "station_for_port"]
