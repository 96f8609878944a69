"""Pure functions on arrays: no frame, file, clock or log is known here."""
