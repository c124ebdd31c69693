"""The command line: parse, call one function, print."""

import errno
import os
import sys
from typing import Annotated

import typer
from typer import Option

from dfdbench.cli.screen import end_unread, say, spell_out_what_cannot_be_shown
from dfdbench.cli.verbs import LazyGroup
from dfdbench.errors import DfdbenchError, Problem, is_lack_of_memory
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.system.parallel import keep_quiet_of_abandoned_tasks

__all__ = ["app", "main"]

app = typer.Typer(
    cls=LazyGroup,
    help="Build depth-from-defocus data sets, run methods on them, and compare.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def version_option(
    version: Annotated[bool, Option("--version", help="Print the version.")] = False,
) -> None:
    """Build depth-from-defocus data sets, run methods on them, and compare."""
    if version:
        print(f"dfdbench {PACKAGE_VERSION}")
        raise typer.Exit


def main() -> None:
    """Run the command line; a user's mistake ends with a message and status 2."""
    spell_out_what_cannot_be_shown()
    keep_quiet_of_abandoned_tasks()
    # Figures go into files: no variable names a screen for them.
    os.environ["MPLBACKEND"] = "agg"
    try:
        try:
            app()
        finally:
            # Here and not at the interpreter's end, where a full disk can no longer be reported.
            sys.stdout.flush()
    except DfdbenchError as error:
        say(f"error: {error}")
        sys.exit(2)
    except UnicodeEncodeError as error:
        if "surrogates" not in error.reason:
            raise
        # A name may have come in by any option, argument, folder or variable.
        got = ascii(error.object)[:100]
        say(f"error: {Problem('a name that is not UTF-8', got=got, fix='rename it')}")
        sys.exit(2)
    except BrokenPipeError:
        end_unread()
    except OSError as error:
        # No room, too long a name, a folder that is gone: it may have come in by any option.
        if not error.strerror or is_lack_of_memory(error):
            raise
        say(f"error: {Problem(error.strerror, where=str(error.filename or ''))}")
        sys.stderr.flush()
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            # What standard output still holds cannot be written either.
            os._exit(2)
        sys.exit(2)
