"""What a run looks like to a person: figures, a console summary, a text."""

import logging

# at length it says that it has no home for its list of fonts, or that a font lacks a weight
logging.getLogger("matplotlib").setLevel(logging.ERROR)
