"""Thermal drift of fibre-optic gyros."""
