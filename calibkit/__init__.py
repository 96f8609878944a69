"""Calibration of fibre-optic gyros, accelerometers and borehole inclinometers."""

__version__ = "0.1.0"
