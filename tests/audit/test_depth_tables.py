from __future__ import annotations

import numpy as np

from dfdbench.audit.depth_tables import depth_table
from dfdbench.audit.sides import scene_histograms, side_of
from dfdbench.datasets.store import Store


def test_levels_stand_sixteen_a_row_and_each_by_itself_as_data(tiny_store: Store) -> None:
    side = side_of(tiny_store, scene_histograms(tiny_store), "Three", ("Three",))
    counts = side.histogram.counts
    table = depth_table(side)
    assert table.title == "depths of tiny-1, Three (3 pairs of 1 scene)"
    assert [row[0] for row in table.rows][::15] == ["0-15", "240-255"]
    assert [int(row[1].replace(",", "")) for row in table.rows] == [
        counts[first : first + 16].sum() for first in range(0, 256, 16)
    ]
    assert [record["pixels"] for record in table.records] == counts.tolist()
    assert np.isclose(sum(float(str(record["share"])) for record in table.records), 1)


def test_levels_that_do_not_occur_are_named_and_scenes_that_are_not_there(
    tiny_store: Store,
) -> None:
    histograms = scene_histograms(tiny_store)
    del histograms["Two"]
    side = side_of(tiny_store, histograms, "all", ("One", "Two", "Three"))
    counts = side.histogram.counts
    table = depth_table(side)
    absent = [row[3] for row in table.rows]
    assert [gaps == "all" for gaps in absent] == [
        not counts[first : first + 16].any() for first in range(0, 256, 16)
    ]
    assert table.notes[-1] == "not in the store, so not counted: Two"
