"""Bias of the channels of a static instrument against one thermometer."""
