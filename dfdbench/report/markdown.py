"""The report as Markdown with pictures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import jinja2

from dfdbench.figures.runs import panel_figure
from dfdbench.figures.style import write_figure
from dfdbench.report.content import Content, gather, write_plots
from dfdbench.results.saved_run import SavedRun
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown, escape_markdown

_PAGE = "report.md"
_WORST = 6


def write_markdown(
    runs: Sequence[SavedRun], protocol: str, folder: Path, also: Sequence[str] = ()
) -> Path:
    """Write a report on runs into a folder as ``report.md`` with PNG files; return its path.

    `also` names further forms of the plots, "pdf" and "svg".
    """
    content = gather(runs, protocol)
    folder.mkdir(parents=True, exist_ok=True)
    plots = write_plots(content, folder, ("png", *also))
    template = resources.files("dfdbench.report") / "report.md.jinja"
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters |= {"table": as_markdown, "text": escape_markdown}
    text = environment.from_string(template.read_text("utf-8")).render(
        content=content, plots=plots, panels=_panels(content, folder)
    )
    path = folder / _PAGE
    write_whole(path, text.rstrip("\n") + "\n")
    return path


def _panels(content: Content, folder: Path) -> list[tuple[str, str]]:
    runs = {run.path: run for run, _ in content.pairs}
    drawn = []
    for number, run in enumerate(runs.values(), 1):
        worst = tuple(pair for of, pair in content.pairs if of is run)[:_WORST]
        assert run.store is not None
        place = run.path.parent
        figure = panel_figure(run.store, run.result, place, worst, content.protocol, "worst")
        if figure is not None:
            file = f"worst-{number}.png"
            write_figure(figure, folder / file)
            drawn.append((run.label, file))
    return drawn
