"""Hundreds of devices with one recipe: one run per device, made by processes here or on a cluster,
and one table of them all.
"""
