"""What a run looks like to a person: figures, a console summary, a text."""
