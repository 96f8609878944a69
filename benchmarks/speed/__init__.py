"""Rows of the speed table: what is run on which data, beside which peer, and how the two are held
against each other.
"""
