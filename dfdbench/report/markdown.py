"""The report as Markdown with pictures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import jinja2

from dfdbench.figures.runs import panel_figure
from dfdbench.figures.style import write_figure
from dfdbench.report.content import Content, gather
from dfdbench.report.plot_files import write_plots
from dfdbench.results.saved_run import SavedRun
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown, escape_markdown

_PAGE = "report.md"
_WORST = 6


def write_markdown(
    runs: Sequence[SavedRun], protocol: str, folder: Path, also: Sequence[str] = ()
) -> Path:
    """Write the report as ``report.md`` with PNG files beside it; return its path.

    Parameters
    ----------
    runs : sequence of SavedRun
        What it is about.
    protocol : str
        Under which protocol.
    folder : Path
        Where it goes.
    also : sequence of str
        Further forms of the plots, "pdf" or "svg", beside the PNG files.
    """
    content = gather(runs, protocol)
    folder.mkdir(parents=True, exist_ok=True)
    plots = write_plots(content, folder, ("png", *also))
    template = resources.files("dfdbench.report") / "report.md.jinja"
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters |= {"table": as_markdown, "text": escape_markdown}
    text = environment.from_string(template.read_text(encoding="utf-8")).render(
        content=content, plots=plots, panels=_panels(content, folder)
    )
    path = folder / _PAGE
    write_whole(path, text.rstrip("\n") + "\n")
    return path


def _panels(content: Content, folder: Path) -> list[tuple[str, str]]:
    drawn = []
    for number, run in enumerate(_runs(content), 1):
        worst = tuple(shown.pair for shown in content.pairs if shown.run is run)[:_WORST]
        assert run.store is not None
        figure = panel_figure(
            run.store, run.result, run.path.parent, worst, content.protocol, "worst"
        )
        if figure is not None:
            file = f"worst-{number}.png"
            write_figure(figure, folder / file)
            drawn.append((run.label, file))
    return drawn


def _runs(content: Content) -> list[SavedRun]:
    found: list[SavedRun] = []
    for shown in content.pairs:
        if not any(shown.run is run for run in found):
            found.append(shown.run)
    return found
