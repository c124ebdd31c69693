"""The solvers on parts of photographs."""

from pathlib import Path

import numpy as np

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.methods.graph_cuts import GraphCuts
from dfdbench.methods.mrf import expansion, split
from tests.conftest import aloe_pair, read_rgb


def test_solvers_agree_on_a_part_of_the_published_pair(shared_data: Path) -> None:
    infocus, defocus = (image[150:230, 150:250] for image in aloe_pair(shared_data, 2))
    energy = GraphCuts(RECIPES["text"]).energy(infocus, defocus)
    swept = expansion(energy, max_sweeps=1).energy
    assert split(energy, "high").energy < 1.0005 * swept


def test_split_is_near_expansion_where_one_label_alone_explains_a_pixel(shared_data: Path) -> None:
    # With the matched blur the costs are sharp: splits by the mean cost of a range ended up to
    # 28 % above one sweep of expansion here, and a score would have taken that for the energy's.
    for scene, color_space in (("Books", "ycrcb"), ("Midd1", "rgb")):
        folder, part = shared_data / "middlebury/ThirdSize" / scene, np.s_[100:200, 100:220]
        infocus = read_rgb(folder / "view1.png")[part]
        depth = read_rgb(folder / "disp1.png")[part][..., 0]
        defocus = synthesize(infocus, depth, RECIPES["published"])
        energy = GraphCuts(color_space=color_space).energy(infocus, defocus)
        reference = expansion(energy, start=energy.unary.argmin(axis=2), max_sweeps=1).energy
        assert split(energy).energy < 1.0025 * reference
        assert split(energy, "high").energy < 1.0006 * reference
