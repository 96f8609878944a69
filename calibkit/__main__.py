"""`python -m calibkit` is the command line."""

from calibkit.cli import main

main()
