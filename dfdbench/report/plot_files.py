"""A report's plots as files beside its page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dfdbench.figures.style import write_forms
from dfdbench.report.content import Content


def write_plots(
    content: Content, folder: Path, forms: Sequence[str]
) -> list[list[tuple[str, str]]]:
    """Write each section's plots; return them by section, as (what, file of the first form).

    Parameters
    ----------
    content : Content
        What the report says.
    folder : Path
        Where they go, as ``1-seconds-per-pair.png``.
    forms : sequence of str
        "png", "pdf", "svg"; none writes none.
    """
    written = []
    for number, section in enumerate(content.sections, 1):
        stems = {name: f"{number}-{name.replace(' ', '-')}" for name in section.plots}
        for name, figure in section.plots.items():
            write_forms(figure, folder, stems[name], forms)
        written.append([(name, f"{stem}.{forms[0]}") for name, stem in stems.items() if forms])
    return written
