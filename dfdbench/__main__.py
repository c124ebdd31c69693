"""Start the command line, quickly: ``dfdbench`` and ``python -m dfdbench``."""

import sys

_INTERRUPTED = 130


def main() -> None:
    """Load and run the command line; Ctrl-C ends it with status 130, at any time."""
    try:
        # Imported here: it takes a second, in which Ctrl-C must not show a traceback.
        from dfdbench.cli import main as run

        run()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(_INTERRUPTED)


if __name__ == "__main__":
    main()
