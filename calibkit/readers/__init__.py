"""One log format, one module, one function; the docstring is the format's specification."""
