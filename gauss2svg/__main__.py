"""`python -m gauss2svg` is the command `gauss2svg`."""

from gauss2svg.cli import run

run()
