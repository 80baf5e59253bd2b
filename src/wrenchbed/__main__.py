"""``python -m wrenchbed`` is the command line."""

from wrenchbed.cli import run

run()
