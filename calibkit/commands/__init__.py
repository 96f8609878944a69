"""The commands as functions: from a recipe and its logs to a run folder, a check or a plan."""
