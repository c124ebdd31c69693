import hashlib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.blur.recipe import RECIPES
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Manifest, training_of
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.rendered import seeded
from dfdbench.errors import InputError
from tests.conftest import TINY_TOML

# A released manifest never changes; a correction is a new version with a new line here.
RELEASED = {
    "demo-1": "8da2f41cb57b16ede5edaf55753df6890dfb476824f7e9d505c5feb0da60b6b0",
    "dfd-indoor-1": "3b3bc2220b2635bb39269044cdc0c475e1b86305d2ebbebf32848f05f24d2610",
    "dfd-outdoor-1": "4b9c65b174c72de1ea0572d14e871a510e440e6ea38b5299e669169d886eb79b",
    "idfd-1": "ad241cbbd7386f1d3e196071bf3475cda5180fe243f2beddbb0ad6b391882cd4",
    "middlebury-default-1": "124573f2ca9857e9c38a597ab75a3b4705c2b52898d182ea4f59a575109162e5",
    "middlebury-third-1": "1faf375534bc96dec00374a6bacd12c8280d8c1387e536e34f4441e53c338ed8",
    "realworld-1": "538e64a625824c6f5f691eaaeafcd76ee1025239cbc6df2bc4895b395c5d66b3",
    "realworld-sim-1": "a8644ff74b48e71580a7ef6868d5a0c324d75953d6e56979a0c563d58137ce85",
    "realworld-synthetic-1": "6009745258887c203497d30728c828c7c0f3f045180ea58be35e53262a4a1fcb",
    "zedd-test-1": "090cd97ed322eedbafa867e84aaa4b5c3cc39e65d0fd314d469afc9305d201eb",
    "zedd-1": "ce0a9339a7acfcf6a60b46c8b143b711f5c9c45c71c06a2773f7cd05c39cef9b",
}


def test_released_manifests_never_change_and_are_named_by_name_and_version() -> None:
    folder = resources.files("dfdbench.manifests")
    for name, sha256 in RELEASED.items():
        assert hashlib.sha256((folder / f"{name}.toml").read_bytes()).hexdigest() == sha256
    files = [manifest for manifest in released_manifests() if not seeded(manifest.name)]
    assert {manifest.stem: manifest.sha256 for manifest in files} == RELEASED
    assert {manifest.recipe for manifest in files} <= {None, *RECIPES}


def test_of_one_group_nothing_is_left_to_train(
    tiny_manifest: Manifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert training_of(tiny_manifest, "One") == ("Two", "Three")
    monkeypatch.setattr(Manifest, "groups", {"One": "room", "Two": "room"})
    assert training_of(tiny_manifest, "One") == ("Three",)
    assert training_of(tiny_manifest, "Three") == ("One", "Two")
    monkeypatch.setattr(Manifest, "groups", dict.fromkeys(tiny_manifest.scene_names, "room"))
    with pytest.raises(InputError, match="all other scenes are of its group, room"):
        training_of(tiny_manifest, "One")


def test_only_simulated_captures_are_marked_so() -> None:
    marked = {manifest.stem for manifest in released_manifests() if manifest.simulated}
    assert marked == {"realworld-sim-1"}
    assert find_manifest("realworld-sim").label == "realworld-sim-1 (SIMULATED)"
    assert find_manifest("demo").label == "demo-1"


@pytest.mark.parametrize("name", ["middlebury", "middlebury-default"])
def test_checksums_are_those_of_the_shared_files(shared_data: Path, name: str) -> None:
    folder = shared_data / "middlebury" / "ThirdSize"
    manifest = find_manifest(name)
    assert len(manifest.checksums) > 80
    for file, expected in manifest.checksums.items():
        assert hashlib.sha256((folder / file).read_bytes()).hexdigest() == expected, file


@given(
    views=st.lists(st.integers(0, 9), min_size=1, max_size=4, unique=True),
    exposures=st.lists(st.integers(0, 9), min_size=1, max_size=4, unique=True),
)
def test_pairs_are_the_grid_without_the_exclusions(views: list[int], exposures: list[int]) -> None:
    grid = len(views) * len(exposures)
    instead = {
        "view = [1, 5]": f"view = {views}",
        "exposure = [0, 1]": f"exposure = {exposures}",
        "pairs = 1": f"pairs = {len(exposures)}",
        "pairs = 4": f"pairs = {grid}",
        "pairs = 7": f"pairs = {2 * grid - len(exposures)}",
        "pair_count = 11": f"pair_count = {3 * grid - len(exposures)}",
    }
    lines = [instead.get(line, line) for line in TINY_TOML.splitlines()]
    text = "\n".join(lines).replace("{ view = [5], exposure = [1] }", f"{{ view = [{views[0]}] }}")
    manifest = parse_manifest(text.encode(), "tiny-1.toml")
    pairs = manifest.pairs()
    assert len(set(pairs)) == len(pairs) == 3 * grid - len(exposures)
    assert set(manifest.pairs("train")) | set(manifest.pairs("test")) == set(pairs)
    assert not set(manifest.pairs("train")) & set(manifest.pairs("test"))
    assert len({pair.id for pair in pairs}) == len(pairs)


def test_a_sigma_turns_with_its_depth_and_is_above_0_at_and_beyond_the_ends(
    tiny_manifest: Manifest,
) -> None:
    scale = DepthScale(law="inverse", near=0.6, far=6.0, near_level=255, far_level=1)
    about = tiny_manifest.depth.model_copy(update={"scale": scale, "unit": "metres"})
    levels = np.linspace(0, 255, 52).astype(np.float32)
    levels[3] = np.nan
    sigma = np.where(np.isnan(levels), np.nan, 0.5).astype(np.float32)
    metres, turned = about.answer_of_unit(levels, sigma, "levels")
    assert turned is not None
    known = ~np.isnan(levels)
    assert np.array_equal(np.isnan(turned), ~known)
    # z = 1 / (a + b level), so dz = z^2 b dlevel.
    slope = (1 / 0.6 - 1 / 6) / 254
    expected = 0.5 * slope * metres**2
    np.testing.assert_allclose(turned[known][4:-4], expected[known][4:-4], rtol=0.01)
    assert (turned[known] > 0.3 * expected[known]).all()
    as_levels = about.model_copy(update={"unit": "level"})
    again, back = as_levels.answer_of_unit(metres, turned, "metres")
    np.testing.assert_allclose(again[1:], np.maximum(levels, 1)[1:], atol=0.01)
    assert back is not None
    np.testing.assert_allclose(back[known][4:-4], 0.5, rtol=0.02)
    assert about.answer_of_unit(metres, turned, "metres")[1] is turned
    # Of a wide one the mean slope counts: an inverse scale is anything but straight.
    middle, hundred = np.full(1, 128, np.float32), np.full(1, 100, np.float32)
    wide = about.answer_of_unit(middle, hundred, "levels")[1]
    ends = scale.to_metres(np.array([28, 228]))
    assert wide == pytest.approx(abs(ends[0] - ends[1]) / 2, rel=1e-4)
