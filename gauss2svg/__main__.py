"""`python -m gauss2svg`."""

from gauss2svg.cli.main import run

if __name__ == "__main__":
    run()
