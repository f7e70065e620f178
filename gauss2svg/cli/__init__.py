"""The command line: a module for each command, and modules for the streams and the signals."""
