"""The program `gauss2svg`: signals are handled before anything slow is imported."""

from gauss2svg.cli.signals import exit_before_fits


def run() -> None:
    """The command as a program."""
    exit_before_fits()
    from gauss2svg.cli.main import run as run_command

    run_command()


if __name__ == "__main__":
    run()
