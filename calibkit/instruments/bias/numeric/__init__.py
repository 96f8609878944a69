"""Equations: arrays in, arrays out."""
