"""Records over time: what changed between two runs, and how a unit's coefficients moved over
years.
"""
