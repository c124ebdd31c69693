"""What several test files need: the shared images, a tiny data set, the demo store."""

import itertools
import logging
import os
import shutil
import uuid
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zarr
from hypothesis import settings
from numpy.typing import ArrayLike, NDArray
from upath import UPath

from dfdbench.blur.recipe import RECIPES
from dfdbench.building import fetching
from dfdbench.building.build import build_store
from dfdbench.building.sources import demo, open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.methods.data_cost import data_cost
from dfdbench.methods.mrf import Energy, published
from dfdbench.rig.registration import register, sight, write_registration
from dfdbench.simulation.board_scene import CaptureSettings, write_captures
from dfdbench.system.location import as_location
from dfdbench.system.parallel import Threads
from tests.made_captures import STEPS, raw_scene
from tests.once import made_once
from tests.site import Site, served

# A loaded machine is slow, and slowness is no defect of what is tested.
settings.register_profile("dfdbench", deadline=None)
settings.load_profile("dfdbench")

#: On tests that ask for `cluster` or `object_store` by a parameter: servers take seconds to start
#: and live in one process, so one worker of pytest-xdist runs all that need them.
ON_SERVERS = pytest.mark.xdist_group("servers")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of a file on one worker; those that need a server, or captures, are slow."""
    for item in items:
        if {"cluster", "object_store"} & {*getattr(item, "fixturenames", ())}:
            item.add_marker(ON_SERVERS)
        if item.get_closest_marker("xdist_group") == ON_SERVERS.mark:
            item.add_marker(pytest.mark.slow)
        elif "captures" in getattr(item, "fixturenames", ()):
            # Made once, for which the other worker would wait.
            item.add_marker(pytest.mark.xdist_group("captures"))
            item.add_marker(pytest.mark.slow)
        elif not item.get_closest_marker("xdist_group"):
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition("::")[0]))


TINY_TOML = """
schema_version = 1
name = "tiny"
short = "tiny"
version = 1
title = "Tiny set"
description = "Three scenes for tests."
reader = "middlebury"
recipe = "published"
degradation = "clean"
network_crop = 16
scene_count = 3
pair_count = 11
sources = [{ name = "here", url = "https://example.org/tiny", licence = "no", citations = ["no"] }]
folds = [{ name = "K1", test_scenes = ["One", "Two"] }, { name = "K2", test_scenes = ["Three"] }]

[axes]
view = [1, 5]
illumination = [1]
exposure = [0, 1]

[depth]
axes = ["view"]
unknown = 0
grows_with = "nearness"
unit = "levels"

[table]
blocks = "exposure"
rows = "illumination"

[[exclusions]]
scenes = ["Three"]
coordinates = { view = [5], exposure = [1] }
pairs = 1
reason = "for the test"

[[splits]]
name = "train"
partition = "only"
pairs = 4
scenes = ["One"]

[[splits]]
name = "test"
partition = "only"
pairs = 7
scenes = ["Two", "Three"]
""" + "".join(
    f'\n[[scenes]]\nname = "{name}"\nsource = "here"\n' for name in ("One", "Two", "Three")
)

# The same scenes in the site's default lighting alone, as the set middlebury-default.
_BLOCKS = TINY_TOML.split("\n\n")
TINY_DEFAULT_TOML = "\n\n".join(block for block in _BLOCKS if "[[exclusions]]" not in block)
for _old, _new in {
    "pair_count = 11": "pair_count = 6",
    "view = [1, 5]\nillumination = [1]\nexposure = [0, 1]": "view = [1, 5]",
    'blocks = "exposure"\nrows = "illumination"': 'blocks = "view"',
    "pairs = 4": "pairs = 2",
    "pairs = 7": "pairs = 4",
}.items():
    TINY_DEFAULT_TOML = TINY_DEFAULT_TOML.replace(_old, _new)


def shared_data_folder() -> Path | None:
    named = os.environ.get("DFDBENCH_SHARED_DATA")
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(named) if named else beside
    return folder if (folder / "middlebury").is_dir() else None


@pytest.fixture(scope="session")
def shared_data() -> Path:
    folder = shared_data_folder()
    if folder is None:
        pytest.skip("no shared Middlebury images: set DFDBENCH_SHARED_DATA")
    return folder


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    # Not made before somebody needs it: thousands of folders take their time.
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path_factory.getbasetemp() / uuid.uuid4().hex))


@pytest.fixture
def tiny_manifest() -> Manifest:
    return parse_manifest(TINY_TOML.encode(), "tiny-1.toml")


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    done, content = cv2.imencode(".png", image)
    assert done
    path.write_bytes(content.tobytes())


def make_tiny_set(folder: Path) -> None:
    """Write the tiny set's files in the site's layout, scenes differing in width; build it."""
    random = np.random.default_rng(3)
    for number, scene in enumerate(("One", "Two", "Three")):
        shape = (24, 30 + number)
        for view in (1, 5):
            depth = random.integers(0, 256, shape).astype(np.uint8)
            write_png(folder / "site" / scene / f"disp{view}.png", depth)
            for exposure in (0, 1):
                image = random.integers(0, 256, (*shape, 3)).astype(np.uint8)
                write_png(folder / "site" / scene / f"Illum1/Exp{exposure}/view{view}.png", image)
    store_of(TINY_TOML, folder / "site", folder / "tiny.zarr")


def make_published(folder: Path, scenes: Sequence[str], exposures: Sequence[int] = (30,)) -> Path:
    """Write scenes of the real-world set as published, noise for images; return the folder."""
    random = np.random.default_rng(8)
    for scene in scenes:
        for exposure, step in itertools.product(exposures, STEPS):
            image = random.integers(0, 256, (630, 630, 3)).astype(np.uint8)
            name = f"exp_{exposure}/image_{step}_{exposure}.00.png"
            write_png(folder / scene / "left" / name, image)
        levels = np.linspace(150, 220, 630).astype(np.uint8)[np.newaxis].repeat(630, axis=0)
        levels[:9], levels[9:20] = 0, 255
        write_png(folder / scene / "lidar/lidar_rng_left_00000_8bit_x6.png", levels)
    return folder


def rewrite_array(store: Dataset, name: str, change: Callable[[NDArray[Any]], ArrayLike]) -> None:
    """Change an array of a store on disk, and nothing that the store says of it."""
    array = zarr.open_group(str(store.path), mode="r+")[name]
    assert isinstance(array, zarr.Array)
    array[...] = np.asarray(change(np.asarray(array[...])))


def store_of(manifest: Manifest | str, folder: Path, place: Path) -> Dataset:
    """Build a set from files; a text is the tiny set's manifest, edited."""
    if isinstance(manifest, str):
        manifest = parse_manifest(manifest.encode(), "tiny-1.toml")
    build_store(manifest, open_source(manifest, folder), place)
    return Dataset(place)


@pytest.fixture(scope="session")
def tiny_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `site` and `tiny.zarr`; never changed: tests get copies."""
    return made_once(tmp_path_factory, "tiny", make_tiny_set)


@pytest.fixture
def tiny_folder(tiny_set: Path, tmp_path: Path) -> Path:
    """The tiny set's files in the site's layout; scenes differ in width."""
    return Path(shutil.copytree(tiny_set / "site", tmp_path / "site"))


@pytest.fixture
def tiny_store(tiny_set: Path, tmp_path: Path) -> Dataset:
    return Dataset(shutil.copytree(tiny_set / "tiny.zarr", tmp_path / "tiny.zarr"))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ask a server a few times in quick succession."""
    for name, value in {"_TRIES": 4, "_PAUSE": 0.01, "_SILENCE": 2.0}.items():
        monkeypatch.setattr(fetching, name, value)


#: Where a server has the tiny set's files.
BELOW = "data/scenes/ThirdSize"


@pytest.fixture
def site(tiny_folder: Path, tmp_path: Path) -> Iterator[Site]:
    """A server that has the tiny set's files."""
    place = tmp_path / "server" / BELOW
    place.parent.mkdir(parents=True)
    tiny_folder.rename(place)
    with served(tmp_path / "server") as site:
        yield site


def served_by(site: Site, toml: str = TINY_TOML) -> str:
    """The tiny set's manifest with the site's address in it."""
    return toml.replace("https://example.org/tiny", f"{site.address}/{BELOW}")


@pytest.fixture(scope="session")
def demo_store(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The demo set, built; never changed."""

    return Dataset(made_once(tmp_path_factory, "demo", build_demo) / "demo-1.zarr")


def build_demo(folder: Path) -> None:
    manifest = find_manifest("demo")
    build_store(manifest, open_source(manifest), folder / "demo-1.zarr", pool=Threads(2))


@pytest.fixture
def demo_built(demo_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache where the demo set of the session stands for the one that a build would make."""
    return cache_with(demo_store, tmp_path, monkeypatch)


def cache_with(store: Dataset, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (folder / "cache/stores").mkdir(parents=True)
    (folder / "cache/stores/demo-1.zarr").symlink_to(str(store.path))
    monkeypatch.setenv("DFDBENCH_CACHE", str(folder / "cache"))
    return folder / "cache"


#: The middle of the demo set's images, a tenth of their pixels.
SMALL = (72, 96)


@pytest.fixture(scope="session")
def small_demo(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The demo set's pairs in small, for what any scores will do; never changed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "_SHAPE", SMALL)
        return Dataset(made_once(tmp_path_factory, "small-demo", build_demo) / "demo-1.zarr")


@pytest.fixture(scope="session")
def few_demo(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The small demo set in one light at one exposure: 18 pairs, of which 12 train."""
    text = find_manifest("demo").toml
    for old, new in {
        'name = "demo"\nshort = "demo"': 'name = "few"\nshort = "few"',
        "illumination = [1, 2, 3]": "illumination = [2]",
        "exposure = [0, 1, 2]": "exposure = [2]",
        "pair_count = 162": "pair_count = 18",
        "pairs = 108": "pairs = 12",
        "pairs = 54": "pairs = 6",
    }.items():
        text = text.replace(old, new)
    manifest = parse_manifest(text.encode(), "few-1.toml")

    def build(folder: Path) -> None:
        build_store(manifest, open_source(manifest), folder / "few-1.zarr")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "_SHAPE", SMALL)
        return Dataset(made_once(tmp_path_factory, "few-demo", build) / "few-1.zarr")


@pytest.fixture
def small_demo_built(small_demo: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with the small demo set, of which tracks are as small, too."""
    monkeypatch.setattr(demo, "_SHAPE", SMALL)
    return cache_with(small_demo, tmp_path, monkeypatch)


@pytest.fixture(scope="session")
def object_store() -> Iterator[str]:
    """The URL of a bucket in an S3-compatible server on the loopback."""
    # Imported here: only one worker has servers, and they take seconds.
    import boto3
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    _, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        }.items():
            patch.setenv(name, value)
        boto3.client("s3").create_bucket(Bucket="bench")
        yield "s3://bench"
    server.stop()


@pytest.fixture(scope="session")
def cluster(object_store: str) -> Iterator[str]:
    """The address of a scheduler with two worker processes, which know the object store."""
    from distributed import LocalCluster

    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        yield str(cluster.scheduler_address)


@pytest.fixture(params=["disk", "memory", pytest.param("s3", marks=ON_SERVERS)])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[str], UPath]:
    """Places by name: in a folder, in memory, in an object store."""
    if request.param == "s3":
        base = f"{request.getfixturevalue('object_store')}/{uuid.uuid4().hex}"
    else:
        base = str(tmp_path) if request.param == "disk" else f"memory://{uuid.uuid4().hex}"
    return lambda name: as_location(f"{base}/{name}")


def read_rgb(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), np.uint8)


def aloe_pair(shared_data: Path, exposure: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return Aloe, Illum1, view 1, at an exposure: in focus, and blurred as it was published."""
    infocus = shared_data / f"middlebury/ThirdSize/Aloe/Illum1/Exp{exposure}/view1.png"
    defocus = f"published_blur/Aloe/Illum1_Exp{exposure}_view1_lin_0.32_2.88.png"
    return read_rgb(infocus), read_rgb(shared_data / defocus)


def aloe_depth(shared_data: Path) -> NDArray[np.uint8]:
    return read_rgb(shared_data / "middlebury/ThirdSize/Aloe/disp1.png")[..., 0].copy()


@pytest.fixture(scope="session")
def aloe(shared_data: Path) -> Callable[[int], Energy]:
    """The published energy of `aloe_pair`, by exposure, with the text's step."""

    def build(exposure: int) -> Energy:
        infocus, defocus = (
            np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb), np.uint8)
            for image in aloe_pair(shared_data, exposure)
        )
        unary, offset = data_cost(infocus, defocus, RECIPES["text"].sigmas)
        return Energy(unary, published(256), offset=offset)

    return build


@pytest.fixture(scope="session")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated raw captures of k01 (oblique) and k03 (flat, near), registered; never changed."""
    return made_once(tmp_path_factory, "captures", make_captures)


def make_captures(folder: Path) -> None:
    manifest = find_manifest("realworld")
    assert manifest.capture is not None
    taken = CaptureSettings(STEPS, (40,))
    write_captures(folder, ("k01", "k03"), manifest.capture, taken, workers=2)
    scenes = {name: raw_scene(folder, name) for name in ("k01", "k03")}
    rig = next(iter(scenes.values())).rig
    sightings = {
        name: sight(scene.frame(40, 135), scene.ranges(), scene.beams(), rig)
        for name, scene in scenes.items()
    }
    for name, found in register(sightings, rig)[0].items():
        corners = sightings[name].rays.corners()
        write_registration(scenes[name].registration, found.matrix, corners, "by the tests")
