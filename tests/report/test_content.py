from pathlib import Path

import pytest
from matplotlib.figure import Figure

from dfdbench.errors import UnknownNameError
from dfdbench.report.content import Content, Section, gather, write_plots
from dfdbench.results.record import Result
from dfdbench.results.saved_run import SavedRun
from tests.made_results import limited, make_result

PAIRS = {("k00", 1, 1, 0): 0.4, ("k00", 1, 1, 1): 0.2, ("k01", 1, 1, 0): 0.1}


def gathered(folder: Path, *results: Result, protocol: str = "thesis") -> Content:
    runs = []
    for number, result in enumerate(results):
        path = folder / f"{number}.json"
        # Only its age is read.
        path.touch()
        runs.append(SavedRun(path, result, None, "no depth maps"))
    return gather(runs, protocol)


def test_runs_of_one_data_set_are_one_section_best_first(tmp_path: Path) -> None:
    worse = {place: 2 * nrmse for place, nrmse in PAIRS.items()}
    content = gathered(tmp_path, make_result(worse, "worse"), make_result(PAIRS, "better"))
    (section,) = content.sections
    assert content.methods == ("better", "worse")
    assert [label for label, _ in section.details] == ["better", "worse"]
    assert content.title == "Depth from defocus: 2 methods"
    assert "best of 2: better, NRMSE 0.2333" in content.summary[0]
    assert content.missing == ("better: no depth maps", "worse: no depth maps")


def test_other_data_are_another_section(tmp_path: Path) -> None:
    here = make_result(PAIRS)
    moved = here.dataset.model_copy(update={"fingerprint": "3" * 64})
    content = gathered(tmp_path, here, here.model_copy(update={"dataset": moved}))
    assert [section.fingerprint[0] for section in content.sections] == ["2", "3"]


def test_a_limited_run_has_no_empty_table(tmp_path: Path) -> None:
    ((_, tables),) = gathered(tmp_path, limited(make_result(PAIRS), 2)).sections[0].details
    assert tables
    assert all(table.rows for table in tables)
    assert not any("spread" in table.title for table in tables)
    ((_, tables),) = gathered(tmp_path, make_result(PAIRS)).sections[0].details
    assert any("spread" in table.title for table in tables)


def test_a_run_that_was_not_scored_so_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="valid"):
        gathered(tmp_path, make_result(PAIRS), protocol="valid")


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
