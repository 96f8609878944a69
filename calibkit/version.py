"""Version of calibkit, which every file that it writes states."""

__version__ = "0.2.0"
SOFTWARE = f"calibkit {__version__}"
"""As files state it."""
