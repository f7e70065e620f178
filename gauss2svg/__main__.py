"""Entry point of the program `gauss2svg`. It handles signals before it imports anything slow."""

import os

from gauss2svg.cli.terminal import exit_before_fits
from gauss2svg.processes import importing


def run() -> None:
    """Run the command line as a program."""
    exit_before_fits()
    # NumPy's matrices are small here. With several threads, OpenBLAS would only wait on more cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with importing():
        from gauss2svg.cli.main import run as run_command

    run_command()


if __name__ == "__main__":
    run()
