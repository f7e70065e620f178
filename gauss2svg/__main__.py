"""`python -m gauss2svg` is the command `gauss2svg`."""

import sys

from gauss2svg.cli import main

sys.exit(main())
