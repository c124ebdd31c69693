"""How verbs give a result that may be kept: files in a folder with --out, tables printed.

Messages, progress and single figures are `screen.py`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.cli.screen import print_table, say
from dfdbench.errors import ResultError, reason_of
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table


class AnswerFormat(StrEnum):
    """How the answer is printed."""

    table = "table"
    markdown = "markdown"
    json = "json"


@dataclass(frozen=True)
class Answer:
    """What a verb found.

    Parameters
    ----------
    content : str
        All of it as JSON.
    tables : tuple of Table
        What is shown of it.
    verdict : str
        A last line below the tables; may be empty.
    """

    content: str
    tables: tuple[Table, ...]
    verdict: str = ""


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
            "cannot write the answer",
            where=str(error.filename or place),
            got=reason_of(error),
            fix="choose another place with --out",
        ) from error


def give(
    answer: Answer, format: AnswerFormat, folder: Path, files: Mapping[str, str | Figure]
) -> None:
    """Write an answer's files into a folder, print the answer, say where the files are.

    A reader of standard output that has enough, as ``head`` has, changes nothing: the files are
    there, and the command ends with the status that it would have had.

    Raises
    ------
    ResultError
        Where the folder cannot be written.
    """
    replaced = _write(folder, files)
    try:
        _show(answer, format)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    say(f"written to   {folder}{', in place of an earlier answer' if replaced else ''}")


def _show(answer: Answer, format: AnswerFormat) -> None:
    if format is AnswerFormat.json:
        print(answer.content, end="")
        return
    for table in answer.tables:
        if not table.rows:
            print("\n".join((table.title, *table.notes)))
        elif format is AnswerFormat.markdown:
            print(as_markdown(table))
        else:
            print_table(table)
    if answer.verdict:
        print(answer.verdict)


def _write(folder: Path, files: Mapping[str, str | Figure]) -> bool:
    from dfdbench.figures.style import write_figure

    replaced = False
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            path = folder / name
            if isinstance(content, Figure):
                write_figure(content, path)
                continue
            replaced |= path.exists() and path.read_text("utf-8", errors="replace") != content
            write_whole(path, content)
    return replaced
