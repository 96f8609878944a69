"""Simulated campaigns whose certificates are held against the truth."""
