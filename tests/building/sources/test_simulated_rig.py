from pathlib import Path

import numpy as np
import pytest

from dfdbench.board.row_file import known_fingerprints
from dfdbench.building.build import build_store
from dfdbench.building.sources.realworld import RealworldFolder
from dfdbench.building.sources.simulated_rig import SimulatedRig
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import SourceError
from dfdbench.system.parallel import Threads

RELEASED = find_manifest("realworld-sim")
BOARD = Path(__file__).parents[3] / "leaderboard"


@pytest.mark.slow
def test_it_gives_what_the_pipeline_makes_of_simulated_captures(captures: Path) -> None:
    # Of the released set's kind, with what the fixture of captures has.
    scenes = [s for s in find_manifest("realworld").scenes if s.name in ("k01", "k03")]
    axes = {"exposure_ms": [40]}
    source = SimulatedRig(RELEASED.model_copy(update={"scenes": scenes, "axes": axes}))
    pairs = [pair.id for pair in source.available_pairs()]
    assert pairs == ["k01/exposure_ms40", "k03/exposure_ms40"]
    files = RealworldFolder(find_manifest("realworld"), captures, (129, 141))
    made, read = source.read("k01"), files.read("k01")
    at_40_ms = find_manifest("realworld").axes["exposure_ms"].index(40)
    assert (made.infocus[0] == read.infocus[at_40_ms]).all()
    assert (made.defocus[0] == read.defocus[at_40_ms]).all()
    # Both registered the two scenes; here the angles are rounded.
    both = made.valid & read.valid
    assert both.mean() > 0.95
    assert np.abs(made.depth[both].astype(int) - read.depth[both]).max() <= 2
    assert source.signature("k01") != source.signature("k03")


def test_what_cannot_be_simulated_is_told_at_once() -> None:
    assert RELEASED.capture is not None
    axes = {"exposure_ms": [40], "view": [1]}
    capture = RELEASED.capture.model_copy(update={"defocus_step": 99})
    scenes = [RELEASED.scenes[0].model_copy(update={"name": "k64"})]
    other = RELEASED.model_copy(update={"axes": axes, "capture": capture, "scenes": scenes})
    with pytest.raises(SourceError) as said:
        SimulatedRig(other)
    assert [problem.what for problem in said.value.problems] == [
        "the simulated lens has steps 127 to 143, not 99",
        "the simulated rig has one axis, exposure_ms, not ['exposure_ms', 'view']",
        "the simulated scenes are k00 to k63, got k64",
    ]
    with pytest.raises(SourceError, match="section is missing"):
        SimulatedRig(RELEASED.model_copy(update={"capture": None}))


@pytest.mark.slow
def test_the_whole_set_has_the_pinned_fingerprint_with_two_workers(tmp_path: Path) -> None:
    report = build_store(RELEASED, SimulatedRig(RELEASED), tmp_path / "s.zarr", pool=Threads(2))
    assert report.pairs == 16
    assert report.fingerprint in known_fingerprints(BOARD)["realworld-sim-1"]
