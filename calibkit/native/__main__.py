"""Compile the kernels where calibkit is, and say whether they are used."""

import sys

from calibkit.native import FOLDER, state
from calibkit.native.compiling import compile_kernels

wrong = compile_kernels(FOLDER)
sys.stdout.write(f"compiled kernels: {wrong or state()}\n")
sys.exit(1 if wrong else 0)
