"""Start the command line quickly: ``dfdbench`` and ``python -m dfdbench``."""

import gc
import os
import signal
import sys

from dfdbench.statuses import INTERRUPTED, MISTAKE

_NO_MEMORY = """\
error: not enough memory or threads
  fix       allow more (ulimit -v and -u, or the container's limits), or use fewer --workers"""


def main() -> None:
    """Load and run the command line; Ctrl-C ends it with status 130 at any time."""
    _open_what_is_closed()
    # What a cluster sends when time is up: stop as at Ctrl-C, and say how to go on.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Looking for garbage after every 700 new objects takes a tenth of a short command's time.
    gc.set_threshold(20_000)
    try:
        # Imported here because it takes a second, during which Ctrl-C must not show a traceback.
        from dfdbench.cli import main as run

        run()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except (MemoryError, RuntimeError, ImportError, OSError) as error:
        # Caught here because a library may run out of memory while it is imported.
        from dfdbench.errors import is_lack_of_memory

        if not is_lack_of_memory(error):
            raise
        print(_NO_MEMORY, file=sys.stderr)
        sys.exit(MISTAKE)


def _open_what_is_closed() -> None:
    # Otherwise the next file opened would get a closed stream's number, and we would print into it.
    for name, access in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(nowhere, access, encoding="utf-8"))


if __name__ == "__main__":
    main()
