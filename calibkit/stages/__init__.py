"""Stages: a frame or an earlier result and the stage's own part of the recipe in, the next result out."""
