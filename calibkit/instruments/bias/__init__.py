"""Bias of a static instrument over its temperature, or over any other abscissa."""
