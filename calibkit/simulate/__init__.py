"""Lab logs with known truth: physical sensors in simulated chambers and on simulated tables, not
the fitted models.
"""
