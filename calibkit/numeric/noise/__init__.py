"""Allan deviation and the noise terms that it shows."""
