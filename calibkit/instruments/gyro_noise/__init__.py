"""Noise of gyros and accelerometers at rest: Allan and wavelet deviations."""
