from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dfdbench.audit.coverage import Verdict, compare_depths
from dfdbench.audit.run_errors import DepthErrors, LevelErrors, join_errors
from dfdbench.audit.sides import sides_of
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures import audits


def test_offending_ranges_are_marked(tiny_store: Dataset) -> None:
    record = compare_depths(*sides_of(tiny_store))
    top, middle, _ = audits.coverage_figure(record).axes
    assert len(top.patches) == len(middle.patches) == len(record.ranges)
    assert middle.get_yscale() == "log"


def test_masks_lie_over_errors_of_each_scene_s_worst_pair(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    run = run_method(tiny_store, load_for(tiny_store, "constant", {}), "test", tmp_path / "run")
    record = compare_depths(*sides_of(tiny_store))
    join = join_errors(tiny_store, run.result, run.folder, record)
    figure = audits.mask_figure(tiny_store, run.result, run.folder, join)
    rows = [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel().startswith("T")]
    assert sorted(row.split("\n")[0] for row in rows) == ["Three", "Two"]
    bars = audits.level_error_figure(join, "title").axes[0].containers
    present = join.total.pixels > 0
    kinds = [kind for kind in Verdict if (join.levels[kind] & present).any()]
    assert len(bars) == len(kinds)
    assert np.isclose(join.total.pixels.sum(), sum(e.pixels.sum() for e in join.pairs.values()))


def errors_of(name: str, told: int) -> DepthErrors:
    """A hundred pixels at each of the levels 40 to 79, all answered by one level."""
    pixels, answers = np.zeros(256, np.int64), np.zeros((256, 256), np.int64)
    pixels[40:80] = 100
    answers[40:80, told] = 100
    off = np.asarray(np.abs(np.arange(256.0) - told) * pixels, np.float64)
    return DepthErrors(name, ("a",), LevelErrors(pixels, off, np.square(off)), None, answers)


def test_each_run_has_a_curve_and_a_panel_of_its_answers() -> None:
    found = [errors_of("near", 70), errors_of("$far$", 41)]
    figure = audits.depth_error_figure("title", found, DepthScale(near=0.5, far=5.0))
    top, *panels = figure.axes
    assert [line.get_label() for line in top.lines] == ["near", r"\$far\$"]
    levels, means = top.lines[0].get_data()
    shown = ~np.isnan(np.asarray(means))
    assert np.asarray(levels)[shown].tolist() == [*np.arange(41.5, 80, 4)]
    assert np.asarray(means)[shown][0] == pytest.approx(70 - 41.5)
    metres = top.child_axes[0]
    # 2.5 m would be left of the levels that occur.
    assert [text.get_text() for text in metres.get_xticklabels()] == ["2", "1.5"]
    # All of a true level's pixels lie on the one answer; where there are none it is blank.
    image = np.asarray(panels[0].images[0].get_array())
    assert (image[70 // 4, 40 // 4], image.sum()) == (1, 10)
    # The first run may leave pixels out.
    near = np.arange(256) >= 60
    few = LevelErrors(*(np.where(near, part, 0) for part in vars(found[0].levels).values()))
    figure = audits.depth_error_figure("title", [replace(found[0], levels=few), found[1]], None)
    assert figure.axes[0].get_xlim() == (38, 81)
