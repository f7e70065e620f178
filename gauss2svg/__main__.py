"""Entry point of the program `gauss2svg`. It handles signals before it imports anything slow."""

import os

from gauss2svg.cli.terminal import SIGNALS, exit_for, set_handlers


def run() -> None:
    """Run the command line as a program."""
    set_handlers(dict.fromkeys(SIGNALS, exit_for))
    # OpenBLAS starts its threads when NumPy is imported, but no file is made by it.
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gauss2svg.cli.main import run as run_command

    run_command()


if __name__ == "__main__":
    run()
