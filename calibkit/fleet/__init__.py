"""Hundreds of units with one recipe: a run a unit, made by processes here or on a cluster, and one
table of them all.
"""
