"""Run the command line as ``python -m dfdbench``."""

from dfdbench.cli import main

main()
