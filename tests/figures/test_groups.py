import numpy as np

from dfdbench.datasets.manifest import Scene
from dfdbench.figures.groups import group_figures
from tests.made_results import make_result

VALUES = {
    ("k00", 1, 1, 0): 0.4,
    ("k00", 1, 1, 1): 0.2,
    ("k01", 1, 1, 0): 0.1,
    ("k04", 1, 1, 0): 0.6,
    ("k05", 1, 1, 0): 0.3,
}
SCENES = [
    Scene(name=name, source="here", geometry=geometry, texture=texture)
    for name, geometry, texture in (
        ("k00", "flat-far", 0),
        ("k01", "oblique-near-left", 0),
        ("k04", "flat-far", 1),
        ("k05", "oblique-near-left", 1),
    )
]


def test_a_figure_for_each_table_with_the_tables_means() -> None:
    figures = group_figures({"mine": make_result(VALUES)}, "thesis", SCENES)
    assert list(figures) == ["exposure", "geometry", "texture"]
    axis = figures["geometry"].axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == [
        "flat-far",
        "oblique-near-left",
    ]
    means = [container[0].get_xdata()[0] for container in axis.containers]
    assert np.allclose(means, [0.4, 0.2])
    assert [axis.get_xlabel().split()[0] for axis in figures["texture"].axes] == [
        "NRMSE",
        "NMAE",
        "SSIM",
    ]


def test_several_runs_bear_one_name_each_in_the_legend() -> None:
    runs = {"mine": make_result(VALUES), "_other": make_result(VALUES, "other")}
    (legend,) = group_figures(runs, "thesis", SCENES)["geometry"].legends
    assert [text.get_text() for text in legend.get_texts()] == ["mine", " _other"]


def test_scenes_that_nothing_parts_have_no_figure() -> None:
    plain = [Scene(name="k00", source="here")]
    assert group_figures({"mine": make_result(VALUES)}, "thesis", plain) == {}
    pairs = [p.model_copy(update={"status": "failed"}) for p in make_result(VALUES).pairs]
    failed = make_result(VALUES).model_copy(update={"pairs": pairs})
    assert group_figures({"mine": failed}, "thesis", SCENES) == {}
