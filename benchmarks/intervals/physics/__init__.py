"""Devices by their physics, with a fault that their logs do not name, fitted as a user would."""
