"""The command line: one module a command, the terminal, the signals."""
