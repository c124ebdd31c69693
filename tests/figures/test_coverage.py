from pathlib import Path

import numpy as np

from dfdbench.audit.coverage import Verdict, compare_depths
from dfdbench.audit.run_errors import join_errors
from dfdbench.audit.sides import sides_of
from dfdbench.datasets.store import Store
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures.coverage import coverage_figure, level_error_figure, mask_figure


def test_offending_ranges_are_marked(tiny_store: Store) -> None:
    record = compare_depths(*sides_of(tiny_store))
    figure = coverage_figure(record)
    top, middle, _ = figure.axes
    assert len(top.patches) == len(middle.patches) == len(record.ranges)
    assert middle.get_yscale() == "log"


def test_masks_lie_over_the_errors_of_the_worst_pair_of_each_scene(
    tiny_store: Store, tmp_path: Path
) -> None:
    run = run_method(tiny_store, load_for(tiny_store, "constant", {}), "test", tmp_path / "run")
    record = compare_depths(*sides_of(tiny_store))
    join = join_errors(tiny_store, run.result, run.folder, record)
    figure = mask_figure(tiny_store, run.result, run.folder, join)
    rows = [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel().startswith("T")]
    assert sorted(row.split("\n")[0] for row in rows) == ["Three", "Two"]
    bars = level_error_figure(join, "title").axes[0].containers
    present = join.total.pixels > 0
    kinds = [kind for kind in Verdict if (join.levels[kind] & present).any()]
    assert len(bars) == len(kinds)
    assert np.isclose(join.total.pixels.sum(), sum(e.pixels.sum() for e in join.pairs.values()))
