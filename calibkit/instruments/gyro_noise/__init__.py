"""Noise of gyros at rest: Allan and wavelet deviations."""
