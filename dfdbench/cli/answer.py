"""How an answer is printed and kept: tables in three forms, files in a folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.cli.screen import print_table, say
from dfdbench.errors import Problem, ResultError
from dfdbench.files import write_whole
from dfdbench.tables import Table, as_markdown


class AnswerFormat(StrEnum):
    """How the answer is printed."""

    table = "table"
    markdown = "markdown"
    json = "json"


def show(table: Table, format: AnswerFormat) -> None:
    """Print a table for a terminal or in Markdown."""
    if format is AnswerFormat.markdown:
        print(as_markdown(table))
    else:
        print_table(table)


@contextmanager
def writing(place: Path) -> Iterator[None]:
    """Tell as a user's mistake where the block cannot write to a place.

    Raises
    ------
    ResultError
        Where it cannot: a file in the way, no permission, no room.
    """
    try:
        yield
    except OSError as error:
        raise ResultError(
            Problem(
                "cannot write the answer", str(place), got=error.strerror or str(error),
                fix="choose another place with --out",
            )
        ) from error  # fmt: skip


def keep(folder: Path, files: Mapping[str, str | Figure]) -> None:
    """Write texts and figures into a folder and say where they are.

    Raises
    ------
    ResultError
        Where the folder cannot be written.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            if isinstance(content, Figure):
                content.savefig(folder / name, dpi=100)
            else:
                write_whole(folder / name, content)
    say(f"written to   {folder}")
