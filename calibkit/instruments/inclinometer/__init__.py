"""Inclinometers that seek north in four positions."""
