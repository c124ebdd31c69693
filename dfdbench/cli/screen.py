"""What every verb shows its work with: messages, tables, figures, progress, files of answers."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.filesize import decimal
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from dfdbench.errors import InputError, ResultError, reason_of, steering_nothing
from dfdbench.results.output_place import output_place
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown, as_rich, render
from dfdbench.tables.table import Format, Table, least_width

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: How the file of a figure may end.
PICTURES = (".png", ".pdf", ".svg")
#: The status of a command that Ctrl-C ended.
INTERRUPTED = 130
#: How most work that was stopped is taken up.
GOES_ON = "the same command goes on from here"
#: Where no bar can be drawn, a line this often says how far the work is.
_LINE_SECONDS = 60.0


def spell_out_what_cannot_be_shown() -> None:
    r"""Print characters that the terminal's encoding lacks as Python spells them: ``\u2193``."""
    for stream in (sys.stdout, sys.stderr):
        # A test or a caller may have put something else in their place.
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """Print to standard error: what is not the answer itself."""
    print(text, file=sys.stderr)


def say_stopped(stopped: KeyboardInterrupt, resumed: str = "") -> None:
    """Say that Ctrl-C ended the work, and how it goes on.

    The notes that the interrupted work has added to the exception know that best; where there are
    none, it is as `resumed` has it.
    """
    say("; ".join(("stopped", *(getattr(stopped, "__notes__", ()) or [resumed] * bool(resumed)))))


def end_unread() -> NoReturn:
    """End the command where the reader of a pipe, head for example, has enough: no mistake."""
    # Nothing more may be written, not even what Python would say of that as it ends.
    sys.stderr.close()
    os._exit(0)


class _Console(Console):
    def on_broken_pipe(self) -> None:
        # Rich would end the program with status 1, which has a meaning of its own here.
        raise BrokenPipeError


def print_table(table: Table) -> None:
    """Print a table to standard output."""
    console = _Console()
    table = _spelt_out(table, console.encoding)
    # Piped or captured there is no terminal to fit: lines are as long as they need be. On a
    # narrow one the terminal wraps the rows, which loses nothing.
    width = console.width if sys.stdout.isatty() else 200
    for part in as_rich(table):
        console.width = width if isinstance(part, Text) else max(width, least_width(table))
        console.print(part)


def print_tables(tables: Iterable[Table], format: Format | None) -> None:
    """Print tables to standard output in a form; None for the terminal's."""
    if format in (None, Format.table):
        for table in tables:
            print_table(table)
    else:
        print(render(list(tables), format), end="")


def _spelt_out(table: Table, encoding: str) -> Table:
    # Before the columns are measured, so that they stay in line.
    def spelt(text: str) -> str:
        return steering_nothing(text).encode(encoding, "backslashreplace").decode(encoding)

    return replace(
        table,
        title=spelt(table.title),
        columns=tuple(map(spelt, table.columns)),
        rows=tuple(tuple(map(spelt, row)) for row in table.rows),
        notes=tuple(map(spelt, table.notes)),
    )


def save_figure(figure: Figure, path: Path) -> None:
    """Draw a figure into a PNG, PDF or SVG file and say where it lies; no others are replaced.

    Raises
    ------
    InputError
        Where the file is to be something else, or cannot be written.
    """
    from dfdbench.figures.style import write_figure

    if path.suffix.lower() not in PICTURES:
        raise InputError(f"not a picture's name, {', '.join(PICTURES)}", where=str(path))
    output_place(path, option="")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_figure(figure, path)
    except OSError as error:
        what = f"cannot write the figure: {reason_of(error)}"
        raise InputError(what, where=str(path)) from error
    say(f"figure       {path}")


@contextmanager
def progress(what: str, resumed: str = GOES_ON) -> Iterator[Callable[[int, int | None], None]]:
    """Show a bar while the block runs; the block calls what it is given with (done, total).

    Ctrl-C ends the command with status 130 and says how it goes on: in the notes that the
    interrupted work has added to the exception, else as `resumed` has it.
    """
    with _bar(what, resumed=resumed) as step:
        yield step


@contextmanager
def download_progress(what: str) -> Iterator[Callable[[int, int, int], None]]:
    """Show files and bytes while the block runs; it calls with (files, files in all, bytes)."""
    with _bar(what, TextColumn("files, {task.fields[received]}")) as step:
        yield lambda done, total, received: step(done, total, decimal(received))


class Lines:
    """A line every minute where there is no terminal: a log shows that work goes on, and how far.

    Parameters
    ----------
    what : str
        The work.
    quiet : bool
        Say nothing: a bar is drawn.
    """

    def __init__(self, what: str, quiet: bool) -> None:
        self._what, self._quiet = what, quiet
        self._begun = self._said = time.monotonic()
        self._first: int | None = None

    def step(self, done: int, total: int | None, received: str = "") -> None:
        """Take note of what is done; say it where the last line is a minute old."""
        now = time.monotonic()
        if self._first is None:
            # Work taken over from an earlier call tells nothing of the speed.
            self._first, self._begun = done, now
        if self._quiet or now - self._said < _LINE_SECONDS:
            return
        self._said = now
        passed, fresh = now - self._begun, done - self._first
        text = f"{self._what}: {done:,}" + ("" if total is None else f" of {total:,}")
        text += (f" files, {received}" if received else "") + f", {_minutes(passed)} so far"
        if total is not None and fresh > 0:
            text += f", about {_minutes(passed / fresh * (total - done))} left"
        print(text, file=sys.stderr, flush=True)


def _minutes(seconds: float) -> str:
    whole = round(seconds / 60)
    return f"{whole} min" if whole < 60 else f"{whole // 60} h {whole % 60:02} min"


@contextmanager
def _bar(
    what: str, *between: ProgressColumn, resumed: str = GOES_ON
) -> Iterator[Callable[..., None]]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        *between,
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        try:
            task = bar.add_task(Text(what).plain, total=None, received="0 bytes")
            lines = Lines(Text(what).plain, quiet=console.is_terminal)

            def step(done: int, total: int | None, received: str = "") -> None:
                bar.update(task, completed=done, total=total, received=received)
                lines.step(done, total, received)

            yield step
        except KeyboardInterrupt as stopped:
            bar.stop()
            say_stopped(stopped, resumed)
            raise typer.Exit(INTERRUPTED) from None


#: By name; the first is the whole answer as JSON.
Files = Mapping[str, "str | Figure"]


class AnswerFormat(StrEnum):
    """How the answer is printed."""

    table = "table"
    markdown = "markdown"
    json = "json"


Answered = Annotated[AnswerFormat, typer.Option(help="How the answer is printed.")]


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
        what, where = f"cannot write the answer: {reason_of(error)}", str(error.filename or place)
        raise ResultError(what, where=where, fix="choose another place with --out") from error


def give(
    tables: Sequence[Table], format: AnswerFormat, folder: Path, files: Files, verdict: str = ""
) -> None:
    """Write an answer's files into a folder, print the answer, say where the files are.

    A reader of standard output that has enough, as ``head`` has, changes nothing: the files are
    there, and the command ends with the status that it would have had.

    Parameters
    ----------
    tables : sequence of Table
        What is shown of it.
    format : AnswerFormat
        How it is printed.
    folder : Path
        Where its files go.
    files : mapping of str to str or Figure
        By name, the whole answer as JSON first.
    verdict : str
        A last line below the tables; may be empty.

    Raises
    ------
    ResultError
        If the folder cannot be written.
    """
    replaced = _write(folder, files)
    try:
        if format is AnswerFormat.json:
            print(next(iter(files.values())), end="")
        else:
            _show(tables, format, verdict)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    say(f"written to   {folder}{', in place of an earlier answer' if replaced else ''}")


def _show(tables: Sequence[Table], format: AnswerFormat, verdict: str) -> None:
    for table in tables:
        if not table.rows:
            print("\n".join((table.title, *table.notes)))
        elif format is AnswerFormat.markdown:
            print(as_markdown(table))
        else:
            print_table(table)
    if verdict:
        print(verdict)


def _write(folder: Path, files: Files) -> bool:
    from matplotlib.figure import Figure

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
