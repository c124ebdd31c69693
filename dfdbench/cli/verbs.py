"""The verbs by name; a verb, and the libraries that it needs, is imported when it is called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from dfdbench.cli.screen import GOES_ON, INTERRUPTED, end_unread, say_stopped


@dataclass(frozen=True)
class Verb:
    """One verb, before it is imported.

    Parameters
    ----------
    module, attribute : str
        Where its function, or the `typer.Typer` of its own verbs, stands in `dfdbench.cli`.
    summary : str
        The first line of its help, as the list of all verbs shows it.
    goes_on : bool
        Whether the same command, stopped anywhere, goes on where it was.
    verbs : mapping of str to Verb
        Of a group: the verbs in it; it has no module.
    """

    module: str = ""
    attribute: str = ""
    summary: str = ""
    goes_on: bool = False
    verbs: Mapping[str, Verb] | None = None

    def load(self, name: str) -> Any:
        """Import the verb and return it as a command of this name."""
        if self.verbs:
            return LazyGroup(
                name=name,
                help=self.summary,
                verbs=self.verbs,
                no_args_is_help=True,
                rich_markup_mode=None,
            )
        found = getattr(import_module(f"dfdbench.cli.{self.module}"), self.attribute)
        if not isinstance(found, typer.Typer):
            function, found = found, typer.Typer(add_completion=False, rich_markup_mode=None)
            found.command()(function)
        command = get_command(found)
        command.name = name
        return command


_AUDIT = {
    "coverage": Verb(
        "audit",
        "coverage",
        "Ask whether training covers the depths of the test; status 1 where it does not.",
    ),
    "depths": Verb(
        "audit",
        "depths",
        "Count how often each depth occurs, or with --result how far runs are off at each depth.",
    ),
    "split": Verb(
        "audit",
        "split_command",
        "Propose splits or folds by scene whose training covers their tests' depths.",
    ),
    "difficulty": Verb(
        "audit",
        "difficulty",
        "Say for which pixels the blur cannot tell neighbouring depth levels apart.",
    ),
}
_RIG = {
    "optics": Verb(
        "optics", "app", "What a lens does to a point, and which voltage steps make a good pair."
    ),
    "register": Verb(
        "rig",
        "register_scenes",
        "Lay the LIDAR's depth map on the camera's image: a small file and an overlay per scene.",
    ),
    "simulate": Verb("rig", "app", "Make captures as the thesis's rig would write them."),
}
_THESIS = {
    "experiment": Verb(
        "thesis",
        "experiment",
        "Train for each value and seed of an experiment of the thesis; a stopped one is resumed.",
        goes_on=True,
    ),
    "search": Verb(
        "thesis", "app", "Search for a network's architecture, as chapter 6 of the thesis does."
    ),
    "reduce": Verb(
        "thesis",
        "reduce",
        "Count the different outputs of each layer; write configurations of narrower networks.",
    ),
}
VERBS = {
    "list": Verb(
        "datasets", "list_datasets", "List the data sets, their tracks and the registered methods."
    ),
    "info": Verb(
        "datasets", "info", "Show what a data set consists of, or what a built one holds."
    ),
    "build": Verb(
        "building",
        "build",
        "Build a data set; what is fetched or finished already is kept.",
        goes_on=True,
    ),
    "run": Verb(
        "runs",
        "run",
        "Run a method on a data set and print its tables; a stopped run is resumed.",
        goes_on=True,
    ),
    "tracks": Verb(
        "runs",
        "tracks",
        "Run a method over all tracks and severities; a stopped call is resumed.",
        goes_on=True,
    ),
    "transfer": Verb(
        "runs",
        "transfer",
        "Fit a method on each of several data sets and test every fit on all of them.",
        goes_on=True,
    ),
    "predict": Verb(
        "methods",
        "predict",
        "Estimate depth from two photographs, or from a folder of pairs; no data set is needed.",
    ),
    "score": Verb(
        "runs",
        "score",
        "Score depth maps that were made elsewhere, one file per pair; nothing is run.",
    ),
    "compare": Verb(
        "reports",
        "compare",
        "Compare two runs pair by pair: differences, wins, losses, what changed most.",
    ),
    "report": Verb(
        "reports",
        "report",
        "Write a page about runs, pairs worst first, or a paper's table of them.",
    ),
    "leaderboard": Verb(
        "reports",
        "leaderboard_verbs",
        "Rank the results of the leaderboard, print the rankings and write its README.",
    ),
    "train": Verb(
        "training",
        "train_command",
        "Train a network; write its weights, a model card, a log and figures.",
    ),
    "check-method": Verb(
        "methods",
        "check_method_command",
        "Try a method on awkward inputs and say what is wrong, before a long run.",
    ),
    "new-dataset": Verb(
        "building",
        "new_dataset",
        "Look at a folder of captures and write a manifest for a person to finish.",
    ),
    "export": Verb(
        "building",
        "export",
        "Export pairs as PNG files (Middlebury pairs keep the thesis's file names).",
        goes_on=True,
    ),
    "verify": Verb(
        "datasets",
        "verify",
        "Recompute a store's fingerprint and compare it with the recorded one.",
    ),
    "cache": Verb(
        "datasets",
        "cache_app",
        "List what lies in the cache: downloads and built data sets; `clear` removes it.",
    ),
    "doctor": Verb(
        "datasets",
        "doctor",
        "Say what is installed here and what the machine can do: for bug reports.",
    ),
    "audit": Verb(
        summary="Ask whether a test is fair: coverage of depths, splits, difficulty.", verbs=_AUDIT
    ),
    "rig": Verb(summary="Lens and LIDAR: optics, registration, simulated captures.", verbs=_RIG),
    "thesis": Verb(
        summary="Repeat the thesis's experiments, architecture search and reduction.", verbs=_THESIS
    ),
}


class LazyGroup(TyperGroup):
    """Knows its verbs by name, and imports the one that is called."""

    def __init__(
        self, *arguments: Any, verbs: Mapping[str, Verb] | None = None, **more: Any
    ) -> None:
        super().__init__(*arguments, **more)
        self.verbs = verbs or VERBS

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the verbs' names, as the help lists them."""
        return list(self.verbs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a verb; None where there is no such."""
        if cmd_name in self.verbs and cmd_name not in self.commands:
            self.commands[cmd_name] = self.verbs[cmd_name].load(cmd_name)
        return self.commands.get(cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return a verb and what is left for it; of an unknown one the near misses are named."""
        # Known before the verb is imported, which takes long enough to be stopped in.
        ctx.invoked_subcommand = args[0]
        near = [] if args[0] in self.verbs else get_close_matches(args[0], self.verbs)
        if near:
            ctx.fail(f"No such command '{args[0]}'. Did you mean {' or '.join(near)}?")
        return super().resolve_command(ctx, args)

    def make_context(self, *arguments: Any, **more: Any) -> Any:
        """Read the command line; Ctrl-C meanwhile is told, and ends it with status 130."""
        try:
            return super().make_context(*arguments, **more)
        except KeyboardInterrupt as stopped:
            say_stopped(stopped)
            raise typer.Exit(INTERRUPTED) from None

    def invoke(self, ctx: Any) -> Any:
        """Call the verb; Ctrl-C anywhere in it is told, and ends the command with status 130.

        A reader of a pipe that has enough, head for example, ends it with status 0.
        """
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            end_unread()
        except KeyboardInterrupt as stopped:
            verb = self.verbs.get(ctx.invoked_subcommand)
            say_stopped(stopped, GOES_ON if verb and verb.goes_on else "")
            raise typer.Exit(INTERRUPTED) from None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs and what each does, none of them imported."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, verb.summary) for name, verb in self.verbs.items()])
