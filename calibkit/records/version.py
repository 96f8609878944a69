"""Version of calibkit, which every file that it writes states."""

__version__ = "0.3.0.dev0"
SOFTWARE = f"calibkit {__version__}"
"""As files state it."""
