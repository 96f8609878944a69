"""Bias of any channel as a polynomial of temperature."""
