from pathlib import Path

import numpy as np
import pytest
from upath import UPath

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import SUITES
from dfdbench.board.row_file import known_fingerprints
from dfdbench.building.build import build_store, refuse_another_set, scene_dataset
from dfdbench.building.sources import SceneImages, open_source
from dfdbench.datasets.catalog import default_store, find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, SourceError
from dfdbench.system.parallel import Cluster, Pool, Processes, Threads
from tests.conftest import ON_SERVERS, TINY_TOML, store_of
from tests.made_source import MadeSource

# Sets are versioned: another fingerprint would be another data set, and no row is of it.
KNOWN = known_fingerprints(Path(__file__).parents[2] / "leaderboard")


ELSEWHERE = [pytest.param(where, marks=ON_SERVERS) for where in ("cluster", "cluster to s3")]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["processes", *ELSEWHERE])
def test_the_fingerprint_does_not_depend_on_where_it_is_built(
    tiny_folder: Path,
    tiny_store: Dataset,
    tmp_path: Path,
    where: str,
    request: pytest.FixtureRequest,
) -> None:
    pool: Pool = Processes(2)
    place = str(tmp_path / "again.zarr")
    if where == "cluster to s3":
        place = f"{request.getfixturevalue('object_store')}/{tmp_path.name}/again.zarr"
    if where != "processes":
        pool = Cluster(request.getfixturevalue("cluster"))
    seen: list[tuple[int, ...]] = []
    manifest = tiny_store.manifest
    source = open_source(manifest, tiny_folder)
    report = build_store(manifest, source, place, None, pool, lambda *step: seen.append(step))
    assert report.fingerprint == tiny_store.fingerprint
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert build_store(manifest, source, place, None, pool).scenes_kept == tiny_store.scenes


def test_the_demo_set_is_the_same_everywhere(demo_store: Dataset) -> None:
    assert KNOWN["demo-1"] == [demo_store.fingerprint]


def test_a_changed_image_is_seen(tiny_folder: Path, tiny_store: Dataset) -> None:
    site, manifest = tiny_folder / "Two/Illum1", tiny_store.manifest
    (site / "Exp0/view1.png").write_bytes((site / "Exp1/view1.png").read_bytes())
    report = build_store(manifest, open_source(manifest, tiny_folder), tiny_store.path)
    assert report.scenes_built == ("Two",)
    assert report.fingerprint != tiny_store.fingerprint


def test_damaged_files_are_all_named_and_nothing_is_put_into_place(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path
) -> None:
    whole = (tiny_folder / "One/Illum1/Exp0/view1.png").read_bytes()
    (tiny_folder / "One/Illum1/Exp0/view1.png").write_bytes(whole[: len(whole) // 2])
    (tiny_folder / "Two/Illum1/Exp0/view1.png").write_bytes(b"GIF89a and so on")
    (tiny_folder / "Three/disp5.png").write_bytes((tiny_folder / "One/disp5.png").read_bytes())
    source = open_source(tiny_manifest, tiny_folder)
    with pytest.raises(SourceError) as caught:
        build_store(tiny_manifest, source, tmp_path / "s.zarr")
    text = str(caught.value)
    for part in ("damaged", "not a PNG file", "GIF89a", "got 24 rows, 30 columns"):
        assert part in text
    assert not (tmp_path / "s.zarr").exists()
    assert not (tmp_path / "s.zarr.partial").exists()


def test_depth_that_grows_with_distance_is_inverted_before_the_blur(
    tiny_folder: Path, tmp_path: Path
) -> None:
    # Eq. 7.1 of the thesis: depth_inv = 255 - depth.
    text = TINY_TOML.replace('grows_with = "nearness"', 'grows_with = "distance"')
    manifest = parse_manifest(text.encode(), "tiny-1.toml")
    random = np.random.default_rng(0)
    infocus = random.integers(0, 256, (2, 1, 2, 12, 13, 3)).astype(np.uint8)
    depth = random.integers(0, 256, (2, 12, 13)).astype(np.uint8)
    images = SceneImages.of_pairs(infocus, depth, depth > 0, np.ones((2, 1, 2), bool))
    scene = scene_dataset(manifest, "One", images, RECIPES["published"])
    expected = synthesize(infocus[1, 0, 1], 255 - depth[1], RECIPES["published"])
    assert np.array_equal(scene["images"].values[1, 0, 1, 1], expected)
    assert np.array_equal(np.nan_to_num(scene["depth"].values), depth)
    # Methods are given the blur of the levels that they answer in.
    given = store_of(text, tiny_folder, tmp_path / "far.zarr").recipe
    assert given is not None
    assert np.array_equal(synthesize(infocus[1, 0, 1], depth[1], given), expected)


def test_a_captured_set_bears_no_recipe(tmp_path: Path) -> None:
    place = tmp_path / "s.zarr"
    with_recipe = parse_manifest(TINY_TOML.encode(), "tiny-1.toml")
    manifest = parse_manifest(TINY_TOML.replace('recipe = "published"', "").encode(), "tiny-1.toml")
    images = np.full((2, 1, 2, 12, 13, 3), 90, np.uint8)
    depth = np.full((2, 12, 13), 7, np.uint8)
    for wrong, recipe in ((manifest, "published"), (with_recipe, None)):
        with pytest.raises(SourceError, match="they are captured"):
            build_store(wrong, MadeSource(wrong, images, depth, images // 2), place, recipe=recipe)
    bare = MadeSource(manifest, images, depth)
    bare.captures_defocus = True
    with pytest.raises(SourceError, match=r"not both or neither"):
        build_store(manifest, bare, place)
    assert not place.exists()
    build_store(manifest, MadeSource(manifest, images, depth, images // 2, "One"), place)
    store = Dataset(place)
    assert (store.recipe_name, store.recipe) == ("", None)
    assert (store.read(store.pairs("One")[0]).defocus == 45).all()


@pytest.mark.slow
def test_the_shared_middlebury_scenes(shared_data: Path, tmp_path: Path) -> None:
    manifest, folder = find_manifest("middlebury-default"), shared_data / "middlebury"
    assert len(open_source(find_manifest("middlebury"), folder).available_pairs()) == 4
    source = open_source(manifest, folder, manifest.checksums)
    report = build_store(manifest, source, tmp_path / "m.zarr", pool=Threads(2))
    assert (report.pairs, report.missing) == (54, ())
    assert KNOWN["middlebury-default-1"] == [report.fingerprint]


DEMO, CAPTURED = find_manifest("demo"), find_manifest("realworld")


def test_other_blur_or_steps_are_refused_in_the_sets_own_place(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    captured = UPath(default_store(CAPTURED, tmp_path))
    for cache in (tmp_path, tmp_path / "link"):
        blurred = UPath(default_store(DEMO, cache))
        with pytest.raises(InputError, match="--recipe text cannot be given without --store PATH"):
            refuse_another_set(DEMO, blurred, "text", None, tmp_path)
    with pytest.raises(InputError, match="--pair cannot be given without --store PATH"):
        refuse_another_set(CAPTURED, captured, None, (1, 2), tmp_path)
    refuse_another_set(CAPTURED, captured, None, (141, 129), tmp_path)
    refuse_another_set(DEMO, blurred, "published", None, tmp_path)
    for elsewhere in (UPath("memory://mine.zarr"), UPath(tmp_path / "stores/demo-2.zarr")):
        refuse_another_set(DEMO, elsewhere, "text", None, tmp_path)


def test_every_severity_of_every_track_is_data_of_its_own() -> None:
    sets = ("demo-1", "middlebury-default-1")
    on_tracks = {f"{name}@{label}" for name in sets for label in SUITES["tracks-1"]}
    assert set(KNOWN) == {"dfd-indoor-1", "realworld-sim-1", *sets} | on_tracks
    assert len({value for values in KNOWN.values() for value in values}) == len(KNOWN)
