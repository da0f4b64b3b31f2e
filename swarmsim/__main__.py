"""`python -m swarmsim` is the command `swarmsim`."""

from swarmsim.cli import main

main()
