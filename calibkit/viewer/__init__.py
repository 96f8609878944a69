"""A local page over run folders: devices, verdicts, reports, comparisons, history; it reads and
never writes.
"""
