"""Logs as they lie on disk, read into tidy frames."""
