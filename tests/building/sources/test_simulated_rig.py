from pathlib import Path

import numpy as np
import pytest

from dfdbench.board.row_file import known_fingerprints
from dfdbench.building.build import build_store
from dfdbench.building.sources.realworld import RealworldFolder
from dfdbench.building.sources.simulated_rig import SimulatedRig
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from dfdbench.system.parallel import Threads

RELEASED = find_manifest("realworld-sim")
OBLIQUE = ("oblique-near-left", "oblique-near-right")
BOARD = Path(__file__).parents[3] / "leaderboard"


def with_scenes(*names: str) -> Manifest:
    """The released manifest with these scenes, as the fixture of captures has them: at 40 ms."""
    scenes = [scene for scene in find_manifest("realworld").scenes if scene.name in names]
    return RELEASED.model_copy(update={"scenes": scenes, "axes": {"exposure_ms": [40]}})


@pytest.mark.slow
def test_it_gives_what_the_pipeline_makes_of_simulated_captures(captures: Path) -> None:
    source = SimulatedRig(with_scenes("k01", "k03"))
    assert [pair.id for pair in source.available_pairs()] == [
        "k01/exposure_ms40",
        "k03/exposure_ms40",
    ]
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


def test_the_released_set_is_like_the_real_one_and_parts_photographs() -> None:
    whole = {scene.name: scene for scene in find_manifest("realworld").scenes}
    for split in RELEASED.splits:
        scenes = [scene for scene in RELEASED.scenes if scene.name in split.scenes]
        geometries = sorted(scene.geometry or "" for scene in scenes)
        assert geometries == sorted(2 * ["flat-far", "flat-near", *OBLIQUE])
    for scene in RELEASED.scenes:
        assert (scene.geometry, scene.texture) == (
            whole[scene.name].geometry,
            whole[scene.name].texture,
        )
    source = SimulatedRig(RELEASED)
    shown = {
        name: {source._scene(scene).board.texture.photograph for scene in RELEASED.scenes_of(name)}
        for name in ("train", "test")
    }
    assert not shown["train"] & shown["test"]
    # The motorcycle's two photographs are of one thing.
    assert {"motorcycle_left", "motorcycle_right"} <= shown["train"]


def test_a_level_stands_for_the_middle_of_its_centimetre() -> None:
    scale = RELEASED.depth.scale
    assert scale is not None
    assert scale.to_metres(np.array([105, 5, 1])) == pytest.approx([1.505, 2.505, 2.545])


def test_what_cannot_be_simulated_is_told_at_once() -> None:
    assert RELEASED.capture is not None
    other = RELEASED.model_copy(
        update={
            "axes": {"exposure_ms": [40], "view": [1]},
            "capture": RELEASED.capture.model_copy(update={"defocus_step": 99}),
            "scenes": [RELEASED.scenes[0].model_copy(update={"name": "k64"})],
        }
    )
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
