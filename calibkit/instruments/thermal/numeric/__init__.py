"""Equations of the bias of a static instrument: arrays in, arrays out."""
