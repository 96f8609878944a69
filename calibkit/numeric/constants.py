"""Physical constants and conversions that several modules use: each stands here once."""

EARTH_RATE_DPH = 15.041067
"""Rotation of the earth against the stars [°/h]: 7.292115e-5 rad/s (WGS 84, NIMA TR8350.2, table
3.1), to the digits that the published examples were computed with.
"""
STANDARD_GRAVITY_MPS2 = 9.80665
"""Standard gravity [m/s²], the unit that data sheets call g; local gravity is another number."""
SECONDS_PER_MINUTE = 60.0
SECONDS_PER_HOUR = 3600.0
DPH_PER_DPS = 3600.0
"""Degrees per hour in one degree per second."""
ARCSECONDS_PER_DEGREE = 3600.0
REVOLUTION_DEG = 360.0
