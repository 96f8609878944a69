"""Bias as a function of temperature, its rate and lagged temperatures: terms, fits, noise."""
