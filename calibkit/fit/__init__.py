"""One solver for all equations: fits with errors that rows share, and uncertainty of any result."""
