import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.building.sources.realworld import PublishedScene, RawScene, RealworldFolder
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, SourceError
from dfdbench.system.parallel import Threads
from tests.conftest import make_published, read_rgb, store_of, write_png
from tests.made_captures import manifest_with_few_steps, raw_scene

CAPTURED = find_manifest("realworld")
CAPTURE = CAPTURED.capture or pytest.fail("the rig captured it")


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_published(tmp_path_factory.mktemp("published"), ("k33", "k34"), (10, 30))


@pytest.fixture
def spoiled(captures: Path, tmp_path: Path) -> Path:
    """A copy of the simulated captures to damage."""
    shutil.copytree(captures, tmp_path / "raw")
    return tmp_path / "raw"


def test_the_published_layout_is_built_as_captured(published: Path, tmp_path: Path) -> None:
    report = build_store(CAPTURED, open_source(CAPTURED, published), tmp_path / "s.zarr")
    assert (report.pairs, report.scenes_built) == (4, ("k33", "k34"))
    store = Dataset(tmp_path / "s.zarr")
    assert (store.recipe_name, store.recipe) == ("", None)
    assert store.attributes["options"] == {"pair": [141, 129]}
    pair = store.pairs("test")[1]
    assert pair.id == "k33/exposure_ms30"
    images = store.read(pair)
    for image, step in ((images.infocus, 141), (images.defocus, 129)):
        path = published / f"k33/left/exp_30/image_{step}_30.00.png"
        assert (image == read_rgb(path)).all()
    assert not images.valid[:20].any()
    assert images.valid[20:].all()
    assert len(store.pairs("test-pruned")) == 4


def test_another_pair_of_voltage_steps(published: Path) -> None:
    images = RealworldFolder(CAPTURED, published, (141, 135)).read("k34")
    path = published / "k34/left/exp_10/image_135_10.00.png"
    assert (images.defocus[0] == read_rgb(path)).all()
    for wrong in ((141, 141), (141, 99)):
        with pytest.raises(SourceError, match="are not two steps"):
            RealworldFolder(CAPTURED, published, wrong)
    with pytest.raises(SourceError, match="takes the sharpest"):
        open_source(find_manifest("realworld-synthetic"), published, pair=(141, 129))
    with pytest.raises(InputError, match="--pair cannot be given with demo"):
        open_source(find_manifest("demo"), pair=(141, 129))


def test_brighter_is_nearer_and_unknown_stays_0(published: Path, tmp_path: Path) -> None:
    levels = np.linspace(150, 220, 630).astype(np.uint8)
    distances = CAPTURED.toml.replace('grows_with = "nearness"', 'grows_with = "distance"')
    distances = distances.replace("\nversion = 1\n", "\nversion = 9\n")
    as_captured = parse_manifest(distances.encode(), "realworld-9.toml")
    for name, manifest, expected in (
        ("near", CAPTURED, 255 - levels),
        ("far", as_captured, levels),
    ):
        store = store_of(manifest, published, tmp_path / f"{name}.zarr")
        images = store.read(store.pairs("k33")[0])
        assert (images.levels[20:] == expected).all()
        assert (images.levels[:20] == 0).all()
        assert store.attributes["depth_grows_with"] == manifest.depth.grows_with
    assert np.isnan(images.depth[:20]).all()


def test_raw_captures_give_back_the_truth(captures: Path, tmp_path: Path) -> None:
    report = build_store(CAPTURED, open_source(CAPTURED, captures), tmp_path / "s.zarr")
    assert report.pairs == 2
    store = Dataset(tmp_path / "s.zarr")
    for pair in store.pairs("all"):
        images = store.read(pair)
        truth = np.asarray(cv2.imread(str(captures / "truth" / pair.scene / "distance_mm.png"), -1))
        near = np.abs(255 - images.levels.astype(int) - truth.astype(int) // 10) <= 2
        assert near[images.valid].mean() > 0.95
        assert images.valid.mean() > 0.9
        assert images.infocus.shape == (630, 630, 3)
    source = open_source(CAPTURED, captures)
    again = build_store(CAPTURED, source, tmp_path / "t.zarr", pool=Threads(2))
    assert again.fingerprint == report.fingerprint


def test_the_pipeline_never_reads_the_truth(spoiled: Path) -> None:
    before = RealworldFolder(CAPTURED, spoiled).signature("k01")
    shutil.rmtree(spoiled / "truth")
    source = RealworldFolder(CAPTURED, spoiled)
    assert (source.signature("k01"), source.problems) == (before, ())


def test_the_sharpest_step_is_found_in_whole_frames(spoiled: Path) -> None:
    # 3.2.5: found first, cropped then. Noise beyond the crop makes step 129's frames the sharpest.
    scene = raw_scene(spoiled, "k03")
    noise = np.random.default_rng(3).integers(0, 256, (728, 736, 3)).astype(np.uint8)
    top, left = scene.rig.crop_offset
    inner = (slice(top, top + 630), slice(left, left + 630))
    for path in scene.images(40, 129):
        frame = read_rgb(path)
        marred = noise.copy()
        marred[inner] = frame[inner]
        write_png(path, marred)
    manifest = manifest_with_few_steps("realworld-synthetic")
    images = RealworldFolder(manifest, spoiled).read("k03")
    place = manifest.axes["exposure_ms"].index(40)
    assert (images.infocus[place] == scene.image(40, 129)).all()
    levels, valid = scene.depth
    assert (images.valid == valid).all()
    assert (images.depth[valid] == 255 - levels[valid]).all()


@pytest.mark.slow
def test_all_that_is_wrong_is_told_others_build(
    spoiled: Path, published: Path, tmp_path: Path
) -> None:
    for name in ("k32", "k35", "k44", "k45", "k46"):
        shutil.copytree(spoiled / "k03", spoiled / name)
    for name in ("k33", "k34"):
        shutil.copytree(published / name, spoiled / name)
    shutil.rmtree(spoiled / "k32/lidar")
    (spoiled / "k33/left/exp_30/image_129_30.00.png").unlink()
    (spoiled / "k34/lidar/lidar_rng_left_00000_8bit_x6.png").unlink()
    with (spoiled / "k35/lidar/lidar_rng_00002.bin").open("ab") as file:
        file.write(b"more")
    beams = Path(__file__).parents[3] / "manifests/realworld-1/os1_beams.csv"
    (spoiled / "k44/beams.csv").write_text("\n".join(beams.read_text().splitlines()[:-1]))
    frame = np.zeros((20, 30, 3), np.uint8)
    write_png(spoiled / "k45/frames/exp_40/image_141_40.00_1.png", frame)
    cut = spoiled / "k45/frames/exp_40/image_129_40.00_0.png"
    cut.write_bytes(cut.read_bytes()[:1000])
    (spoiled / "k46/registration.toml").unlink()
    (spoiled / "k46/frames/exp_40/image_141_40.00_3.png").unlink()

    source = open_source(CAPTURED, spoiled)
    report = build_store(CAPTURED, source, tmp_path / "s.zarr")
    assert (report.scenes_built, report.pairs) == (("k01", "k03", "k33"), 3)
    said = source.missing_help(report.missing)
    for what, where in (
        ("scene has no lidar/lidar_rng_00000.bin", "k32"),
        ("no image at voltage step 129", "k33, exposure 30 ms"),
        ("scene has no LIDAR depth map", "k34"),
        ("disagrees with the file's length", "k35/lidar/lidar_rng_00002.bin"),
        ("calibration of 63 beams for 64", "k44/beams.csv"),
        ("size differs", "k45/frames/exp_40/image_141_40.00_1.png"),
        ("damaged", "k45/frames/exp_40/image_129_40.00_0.png"),
        ("scene is not registered", "k46/registration.toml"),
        ("only 3 of 4 frames", "image_141_40.00_*.png"),
    ):
        assert what in said
        assert where in said


def test_a_folder_without_scenes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no scene found"):
        open_source(CAPTURED, tmp_path)
    with pytest.raises(SourceError, match="no such folder"):
        open_source(CAPTURED, tmp_path / "none")


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_raw_files_are_found_by_exposure_step_and_number(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    touch(*(frames / f"exp_10/image_{step}_10.00_{n}.png" for step in (129, 141) for n in (0, 1)))
    touch(frames / "exp_5/image_129_5.00_0.png", frames / "exp_x/image_129_10.00_0.png")
    touch(frames / "exp_10/image_thumb_10.00.png", frames / "exp_70")
    scene = RawScene(tmp_path, CAPTURE)
    # A file is no exposure; a folder without a number neither.
    assert (scene.exposures(), scene.steps(10)) == ((5, 10), (129, 141))
    names = [path.name for path in scene.images(10, 141)]
    assert names == ["image_141_10.00_0.png", "image_141_10.00_1.png"]
    assert scene.images(10, 130) == scene.images(20, 141) == []


def test_of_published_depth_maps_the_scaled_one_is_taken(tmp_path: Path) -> None:
    scene = PublishedScene(tmp_path, CAPTURE)
    (problem,) = scene.depth_problems()
    assert problem.what.startswith("scene has no LIDAR depth map")
    touch(tmp_path / "lidar/lidar_rng_left_00000_8bit.png")
    assert [path.name for path in scene.depth_files()] == ["lidar_rng_left_00000_8bit.png"]
    levels = np.full((630, 630), 90, np.uint8)
    levels[0, :3] = (0, 255, 254)
    write_png(tmp_path / "lidar/lidar_rng_left_00000_8bit_x6.png", levels)
    assert scene.depth_problems() == []
    found, valid = scene.depth
    assert np.array_equal(found, levels)
    # 0 and 255 say that nothing came back.
    assert np.argwhere(~valid).tolist() == [[0, 0], [0, 1]]
