"""Triads of accelerometers: K-factor, Q-factor and affine models over temperature."""
