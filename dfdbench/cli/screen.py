"""How verbs show their work: messages, tables, figures, progress, files."""

from __future__ import annotations

import codecs
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from typer import Exit

from dfdbench.errors import InputError, spelt_out
from dfdbench.statuses import DONE, INTERRUPTED
from dfdbench.tables.table import Format, Table, least_width, without

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.progress import Progress


#: The suffixes of figures.
PICTURES = (".png", ".pdf", ".svg")
#: How to resume most work.
GOES_ON = "the same command goes on from here"
#: How to resume work that was started with --fresh.
WITHOUT_FRESH = "the same command without --fresh goes on from here"
# Without a terminal for a bar, a line says this often how far the work is.
_LINE_SECONDS = 60.0
# Going through what an earlier call finished takes less than this.
_TAKEN_OVER_SECONDS = 5.0
_ALIKE = str.maketrans("µμ–—−×±°↓↑→≤≥δσ²³…", "uu---x+ov^><>ds23.")


def spell_out_what_cannot_be_shown() -> None:
    """Print characters that the terminal's encoding lacks as similar ones, or escaped."""
    codecs.register_error("alike", _alike)
    for stream in (sys.stdout, sys.stderr):
        # Tests and callers may have replaced them.
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="alike")


def _alike(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    # Of the same width, since tables are already laid out.
    text = error.object[error.start : error.end].translate(_ALIKE)
    return text.encode("ascii", "backslashreplace").decode(), error.end


def say(text: str) -> None:
    """Print to standard error: anything but the answer itself."""
    print(text, file=sys.stderr)


def command(*words: object, **options: object) -> str:
    """Return a dfdbench command, quoted for a shell; options that are None are left out.

    Examples
    --------
    >>> command("report", "my run", out=None, format="csv", note=["a", "b"])
    "dfdbench report 'my run' --format csv --note a --note b"
    >>> command("report", Path("-full"))
    'dfdbench report ./-full'
    """
    for name, value in options.items():
        for each in value if isinstance(value, list) else [value] * (value is not None):
            words += (f"--{name}", each)
    # A path that begins with a dash would be read as an option.
    dashed = [isinstance(word, Path) and str(word).startswith("-") for word in words]
    given = ("./" * dash + str(word) for dash, word in zip(dashed, words, strict=True))
    return shlex.join(("dfdbench", *given))


def say_stopped(stopped: KeyboardInterrupt, resumed: str = "") -> None:
    """Say that Ctrl-C stopped the work, and how to resume it.

    If the interrupted work added notes to the exception, they say how; otherwise `resumed` does.
    """
    say("; ".join(("stopped", *(getattr(stopped, "__notes__", ()) or [resumed] * bool(resumed)))))


def end_unread() -> NoReturn:
    """End the command because the reader of a pipe, such as `head`, closed it: no mistake."""
    # Write nothing more, not even Python's own message at exit.
    sys.stderr.close()
    os._exit(DONE)


def print_table(table: Table) -> None:
    """Print a table to standard output."""
    # Rich takes half as long to import as numpy: no group's help should wait for it.
    from rich.console import Console
    from rich.text import Text

    from dfdbench.tables.render import as_rich

    class Unread(Console):
        def on_broken_pipe(self) -> None:
            # Rich would end the program with status 1, which has a meaning of its own here.
            raise BrokenPipeError

    console = Unread()
    # Without a terminal, lines may be as long as they need. For a narrow one, some columns are
    # left out first; then the terminal wraps the rows, which loses nothing.
    width = console.width if sys.stdout.isatty() else 200
    if least_width(table) > width:
        table = without(table, "std", "scenes")
    for part in as_rich(table):
        console.width = width if isinstance(part, Text) else max(width, least_width(table))
        console.print(part)


def show(format: str | None, tables: Sequence[Table] = (), text: str = "", **facts: object) -> None:
    """Print an answer to standard output: tables and text for people, or all facts as JSON.

    Parameters
    ----------
    format : str or None
        A `Format`; None for the terminal's.
    tables : sequence of Table
        Shown in every format.
    text : str
        Lines below the tables; left out of JSON and CSV.
    **facts
        The same as data, and what only scripts need; in JSON, beside the tables.
    """
    # Rich and the renderers are slow to import, and not every form needs them.
    form = Format(format or Format.table)
    if form is Format.table:
        for table in tables:
            print_table(table)
    else:
        from dfdbench.tables.render import as_json, render

        print(as_json(tables, **facts) if form is Format.json else render(tables, form), end="")
    if text and form not in (Format.csv, Format.json):
        print(spelt_out(text))


def require_picture(path: Path) -> None:
    """Refuse a file whose name is not a figure's.

    Raises
    ------
    InputError
        If it has another suffix.
    """
    if path.suffix.lower() not in PICTURES:
        raise InputError(f"not a picture's name, {', '.join(PICTURES)}", where=str(path))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG, PDF or SVG file and say where.

    Raises
    ------
    InputError
        If the name is of another kind of file, or the place is in a data set or a run.
    """
    from dfdbench.figures.style import write_figure
    from dfdbench.results.output_place import output_place

    require_picture(path)
    output_place(path, option="")
    write_figure(figure, path)
    say(f"figure       {path}")


@contextmanager
def progress(what: str, resumed: str = GOES_ON) -> Iterator[Callable[..., None]]:
    """Show a bar while the block runs; without a terminal, print a line a minute for the log.

    The block calls what it gets with (done, total), and with bytes or a score if it has them.
    Ctrl-C ends the command with status 130 and says how to resume it: see `say_stopped`.
    """
    from rich.filesize import decimal

    name = spelt_out(what)
    said = begun = opened = time.monotonic()
    first: int | None = None
    with _bar() as bar:

        def step(done: int, total: int | None, beside: int | str | None = None) -> None:
            nonlocal said, begun, first
            more = f"files, {decimal(beside)}" if isinstance(beside, int) else beside or ""
            bar.update(task, completed=done, total=total, more=more)
            now = time.monotonic()
            if first is None or now - opened < _TAKEN_OVER_SECONDS:
                # What an earlier call finished says nothing about the speed.
                first, begun = done, now
            if not bar.disable or now - said < _LINE_SECONDS:
                return
            said, passed = now, now - begun
            text = f"{name}: {done:,}" + ("" if total is None else f" of {total:,}")
            text += (f" {more}" if more else "") + f", {_minutes(passed)} so far"
            if total is not None and done > first:
                text += f", about {_minutes(passed / (done - first) * (total - done))} left"
            print(text, file=sys.stderr, flush=True)

        try:
            task = bar.add_task(name, total=None, more="")
            yield step
        except KeyboardInterrupt as stopped:
            bar.stop()
            say_stopped(stopped, resumed)
            raise Exit(INTERRUPTED) from None


def _bar() -> Progress:
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}", markup=False),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[more]}", markup=False),
        bars.TextColumn("left"),
        bars.TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    return bars.Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _minutes(seconds: float) -> str:
    whole = round(seconds / 60)
    return f"{whole} min" if whole < 60 else f"{whole // 60} h {whole % 60:02} min"


#: Files by name; the first is the whole answer as JSON.
Files = Mapping[str, "str | Figure"]


def give(
    tables: Sequence[Table], format: Format, folder: Path, files: Files, verdict: str = ""
) -> None:
    """Write an answer's files into a folder, print the answer, say where the files are.

    Parameters
    ----------
    tables : sequence of Table
        The answer's tables.
    format : Format
        How it is printed.
    folder : Path
        Where its files go.
    files : mapping of str to str or Figure
        By name, the whole answer as JSON first.
    verdict : str
        A last line below the tables; may be empty.
    """
    from dfdbench.figures.style import write_figure
    from dfdbench.system.files import write_whole

    replaced = False
    for name, content in files.items():
        path = folder / name
        if isinstance(content, str):
            replaced |= path.exists() and path.read_text("utf-8", errors="replace") != content
            write_whole(path, content)
        else:
            write_figure(content, path)
    if format is Format.json:
        print(next(iter(files.values())), end="")
    else:
        show(format, tables, verdict)
    say(f"written to   {folder}{', in place of an earlier answer' if replaced else ''}")
