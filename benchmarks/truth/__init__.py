"""Comparisons by simulated truth: each module makes data, gives them to calibkit and to a packaged
peer, and judges both.
"""
