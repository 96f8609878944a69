"""One package per instrument."""
