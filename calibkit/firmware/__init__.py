"""Coefficient files → the correction chain as firmware runs it; pure functions of the files, the
same bytes everywhere.
"""
