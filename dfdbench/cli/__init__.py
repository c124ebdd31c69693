"""The command line: parse, call one function, print.

A verb, and the libraries that it needs, is imported when it is called.
"""

from __future__ import annotations

import ast
import errno
import os
import re
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from typer import BadParameter, Exit, Option, Typer
from typer.core import TyperGroup
from typer.main import get_command

from dfdbench.cli import screen
from dfdbench.errors import DfdbenchError, Problem, is_lack_of_memory, room_or
from dfdbench.statuses import INTERRUPTED, MISTAKE
from dfdbench.system.parallel import keep_quiet_of_abandoned_tasks


@dataclass(frozen=True)
class Verb:
    """One verb, before it is imported.

    Parameters
    ----------
    place : str
        Its function, as ``module.function`` in `dfdbench.cli`; empty for a group that does nothing
        itself.
    goes_on : bool
        Whether the same command, stopped anywhere, goes on where it was.
    about : str
        The help of a group without a function.
    verbs : mapping of str to Verb
        Of a group: the verbs in it.
    """

    place: str = ""
    goes_on: bool = False
    about: str = ""
    verbs: Mapping[str, Verb] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """The first line of its help, read without importing it."""
        return self.about or _first_line(*self.place.split("."))

    def load(self, name: str) -> Any:
        """Import the verb and return it as a command of this name."""
        style: Any = {"no_args_is_help": not self.place, "rich_markup_mode": None}
        if not self.place:
            return LazyGroup(name=name, help=self.about, verbs=self.verbs, **style)
        module, function = self.place.split(".")
        app = Typer(cls=LazyGroup, add_completion=False, **style)
        kind = app.callback(invoke_without_command=True) if self.verbs else app.command()
        kind(getattr(import_module(f"dfdbench.cli.{module}"), function))
        command: Any = get_command(app)
        command.name, command.verbs = name, self.verbs
        return command


@cache
def _first_line(module: str, function: str) -> str:
    tree = ast.parse(Path(__file__).with_name(f"{module}.py").read_text("utf-8"))
    found = next(node for node in tree.body if getattr(node, "name", "") == function)
    assert isinstance(found, ast.FunctionDef)
    return (ast.get_docstring(found) or "").partition("\n")[0]


_AUDIT = {
    "coverage": Verb("audit.coverage"),
    "depths": Verb("audit.depths"),
    "split": Verb("audit.split_command"),
    "difficulty": Verb("audit.difficulty"),
}
_OPTICS = {name: Verb(f"rig.{name}") for name in ("blur", "pairs", "sharpness")}
_SIMULATE = {"realworld": Verb("rig.simulate_realworld"), "lens": Verb("rig.simulate_lens")}
_RIG = {
    "optics": Verb(
        about="What a lens does to a point, and which voltage steps make a good pair.",
        verbs=_OPTICS,
    ),
    "register": Verb("rig.register"),
    "simulate": Verb(about="Make captures as the thesis's rig would write them.", verbs=_SIMULATE),
}
_THESIS = {
    "experiment": Verb("thesis.experiment", goes_on=True),
    "search": Verb(
        about="Search for a network's architecture, as chapter 6 of the thesis does.",
        verbs={"architecture": Verb("thesis.architecture", goes_on=True)},
    ),
    "reduce": Verb("thesis.reduce"),
}
VERBS = {
    "list": Verb("datasets.list_datasets"),
    "info": Verb("datasets.info"),
    "build": Verb("building.build", goes_on=True),
    "run": Verb("runs.run", goes_on=True),
    "tracks": Verb("runs.tracks", goes_on=True),
    "transfer": Verb("runs.transfer", goes_on=True),
    "tune": Verb("runs.tune"),
    "predict": Verb("methods.predict"),
    "score": Verb("runs.score"),
    "compare": Verb("reports.compare"),
    "report": Verb("reports.report"),
    "leaderboard": Verb("reports.leaderboard", verbs={"verify": Verb("reports.verify_rows")}),
    "train": Verb("training.train_command"),
    "check-method": Verb("methods.check_method_command"),
    "export-onnx": Verb("methods.export_onnx_command"),
    "new-dataset": Verb("building.new_dataset"),
    "export": Verb("building.export", goes_on=True),
    "verify": Verb("datasets.verify"),
    "cache": Verb("datasets.cache_verb", verbs={"clear": Verb("datasets.clear_cache")}),
    "doctor": Verb("datasets.doctor"),
    "audit": Verb(
        about="Ask whether a test is fair: coverage of depths, splits, difficulty.", verbs=_AUDIT
    ),
    "rig": Verb(about="Lens and LIDAR: optics, registration, simulated captures.", verbs=_RIG),
    "thesis": Verb(
        about="Repeat the thesis's experiments, architecture search and reduction.", verbs=_THESIS
    ),
}


# What pydantic says about an option's value.
_IN_OUR_WORDS = {
    r"^Value error, ": "",
    r"^Input should be greater than or equal to (\S+)$": r"must be \1 or more",
    r"^Input should be less than or equal to (\S+)$": r"must be \1 or less",
    r"^Input should be a valid integer.*": "must be a whole number",
    r"^Input should be a valid number.*": "must be a number",
}


class LazyGroup(TyperGroup):
    """Knows its verbs by name, and imports the one that is called."""

    def __init__(
        self, *arguments: Any, verbs: Mapping[str, Verb] | None = None, **more: Any
    ) -> None:
        super().__init__(*arguments, **more)
        self.verbs = verbs or VERBS

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the group's own options."""
        for option in self.get_params(ctx):
            # For typer's own flags, which are None if not given, it would import pydantic, which
            # takes as long as numpy.
            if getattr(option, "is_flag", False) and option.default is None:
                option.default = False
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the verbs' names, as the help lists them."""
        return list(self.verbs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a verb; None if there is no such verb."""
        if cmd_name in self.verbs and cmd_name not in self.commands:
            self.commands[cmd_name] = self.verbs[cmd_name].load(cmd_name)
        return self.commands.get(cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return a verb and its arguments; for an unknown verb, name the near misses."""
        # Set before the verb is imported, which takes long enough for a Ctrl-C.
        ctx.invoked_subcommand = args[0]
        near = [] if args[0] in self.verbs else get_close_matches(args[0], self.verbs)
        if near:
            ctx.fail(f"No such command '{args[0]}'. Did you mean {' or '.join(near)}?")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Call the verb; Ctrl-C anywhere in it ends the command with status 130.

        If the reader of a pipe closes it, as `head` does, the status is 0.
        """
        try:
            return super().invoke(ctx)
        except BadParameter as error:
            for theirs, ours in _IN_OUR_WORDS.items():
                error.message = re.sub(theirs, ours, error.message)
            raise
        except BrokenPipeError:
            screen.end_unread()
        except KeyboardInterrupt as stopped:
            verb = self.verbs.get(ctx.invoked_subcommand)
            screen.say_stopped(stopped, screen.GOES_ON if verb and verb.goes_on else "")
            raise Exit(INTERRUPTED) from None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs and what each does, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, verb.summary) for name, verb in self.verbs.items()])


app = Typer(
    cls=LazyGroup, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None
)


@app.callback(invoke_without_command=True)
def version_option(
    version: Annotated[bool, Option("--version", help="Print the version.")] = False,
) -> None:
    """Build depth-from-defocus data sets, run methods on them, and compare."""
    if version:
        from dfdbench.system.packages import PACKAGE_VERSION

        print(f"dfdbench {PACKAGE_VERSION}")
        raise Exit


def main() -> None:
    """Run the command line; a user's mistake ends with a message and status 2."""
    screen.spell_out_what_cannot_be_shown()
    keep_quiet_of_abandoned_tasks()
    # A run's tables show its warnings.
    warnings.filterwarnings("ignore", module=r"dfdbench\.cli\.")
    # Figures go into files: no variable names a screen for them.
    os.environ["MPLBACKEND"] = "agg"
    try:
        try:
            app()
        finally:
            # Now, because at exit a full disk can no longer be reported.
            sys.stdout.flush()
    except DfdbenchError as error:
        screen.say(f"error: {error}")
        sys.exit(MISTAKE)
    except UnicodeEncodeError as error:
        if "surrogates" not in error.reason:
            raise
        # A name may have come in by any option, argument, folder or variable.
        got = ascii(error.object)[:100]
        screen.say(f"error: {Problem('a name that is not UTF-8', got=got, fix='rename it')}")
        sys.exit(MISTAKE)
    except BrokenPipeError:
        screen.end_unread()
    except OSError as error:
        # No room, too long a name, a folder that is gone: it may have come in by any option.
        if not error.strerror or is_lack_of_memory(error):
            raise
        where, fix = str(error.filename or ""), room_or("choose another place", error)
        screen.say(f"error: {Problem(error.strerror, where=where, fix=fix)}")
        sys.stderr.flush()
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            # What standard output still holds cannot be written either.
            os._exit(MISTAKE)
        sys.exit(MISTAKE)
