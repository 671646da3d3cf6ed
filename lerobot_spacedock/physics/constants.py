"""Physical constants, each once, with its unit in the name and its source beside it."""

EARTH_MU_m3_s2 = 398600.4418e9  # EGM-96 / WGS-84 geocentric gravitational constant, ±8e5 m³/s²
EARTH_EQUATORIAL_RADIUS_m = 6378137.0  # WGS-84 semi-major axis, exact by definition
STANDARD_GRAVITY_m_s2 = 9.81  # as in the reference rollouts (the BIPM value, 9.80665, leaves a residual there)

STATION_ALTITUDE_m = 409e3  # Posadas-Nava et al. 2025, circular orbit of the ISS
ORBIT_RADIUS_m = EARTH_EQUATORIAL_RADIUS_m + STATION_ALTITUDE_m
MEAN_MOTION_rad_s = (EARTH_MU_m3_s2 / ORBIT_RADIUS_m**3) ** 0.5  # 1.129117e-3, period 5564.7 s

CHASER_MASS_kg = 1000.0  # identified from the published rollouts
CHASER_INERTIA_kg_m2 = 2000.0 / 3.0  # uniform cube, 2 m edge, 1000 kg: m a² / 6
SPECIFIC_IMPULSE_s = 300.0  # identified from the published rollouts
THRUST_LIMIT_N = (
    60.0  # per body axis; holds every observed command (norm up to 50.5 N); the authors' own is unpublished
)
TORQUE_LIMIT_Nm = 20.0  # per body axis; holds every observed command (component up to 15.6 N·m)
