"""Plots beside a page."""

from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.report.content import Content, Section
from dfdbench.report.plot_files import write_plots


def content() -> Content:
    plots = {"seconds per pair": Figure(), "by scene": Figure()}
    section = Section("demo-1", "0" * 64, (), (), plots)
    return Content("title", "thesis", (), (), (section, section), (), ())


def test_each_plot_is_written_in_each_form_and_the_first_is_named(tmp_path: Path) -> None:
    written = write_plots(content(), tmp_path, ("png", "svg"))
    assert written == [
        [("seconds per pair", f"{n}-seconds-per-pair.png"), ("by scene", f"{n}-by-scene.png")]
        for n in (1, 2)
    ]
    assert len(list(tmp_path.glob("*.png"))) == len(list(tmp_path.glob("*.svg"))) == 4


def test_no_form_no_file(tmp_path: Path) -> None:
    assert write_plots(content(), tmp_path, ()) == [[], []]
    assert not list(tmp_path.iterdir())
