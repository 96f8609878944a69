"""Calibration certificates: a pure function of a run folder, a laboratory profile, a validation and
a date.
"""
