"""Parts of `coverage.py`: one module per instrument, and how a row is judged."""
