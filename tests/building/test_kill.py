"""Builds killed at random moments, and what the next build makes of what they left."""

from __future__ import annotations

import multiprocessing
import os
import random
import time
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.fetching.checksums import known_checksums
from dfdbench.building.sources import download_middlebury, open_source
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.integrity import verify_store
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.system.parallel import Threads
from tests.conftest import TINY_TOML, write_png
from tests.site import served

BELOW = "data/scenes/ThirdSize"
#: `make kills` asks for more.
MANY = int(os.environ.get("DFDBENCH_KILLS", "24"))


def make_site(folder: Path) -> None:
    """The tiny set with images large enough for a build to take a while."""
    shape = np.random.default_rng(3)
    for scene in ("One", "Two", "Three"):
        for view in (1, 5):
            depth = shape.integers(0, 256, (120, 160)).astype(np.uint8)
            write_png(folder / scene / f"disp{view}.png", depth)
            for exposure in (0, 1):
                image = shape.integers(0, 256, (120, 160, 3)).astype(np.uint8)
                write_png(folder / scene / f"Illum1/Exp{exposure}/view{view}.png", image)


def fetch_and_build(toml: str, downloads: Path, store: Path) -> None:
    """What `dfdbench build` does; run in a process that is killed."""
    manifest = parse_manifest(toml.encode(), "tiny-1.toml")
    download_middlebury(manifest, downloads)
    known = known_checksums(manifest, downloads)
    source = open_source(manifest, downloads, checksums=known)
    build_store(manifest, source, store, pool=Threads(2))


def reference(manifest: Manifest, folder: Path, store: Path) -> str:
    return build_store(manifest, open_source(manifest, folder), store).fingerprint


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kills", "hits"), [(6, 2), pytest.param(MANY, MANY // 2, marks=pytest.mark.slow)]
)
def test_killed_at_random_moments_the_next_build_ends_the_same(
    tmp_path: Path, kills: int, hits: int
) -> None:
    site_folder = tmp_path / "server" / BELOW
    make_site(site_folder)
    with served(tmp_path / "server") as site:
        toml = TINY_TOML.replace("https://example.org/tiny", f"{site.address}/{BELOW}")
        manifest = parse_manifest(toml.encode(), "tiny-1.toml")
        expected = reference(manifest, site_folder, tmp_path / "reference.zarr")
        # Children of a server that has imported all of it: a kill hits the work, not the start.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__])
        # A child that does nothing starts the server that children are forked from.
        process = context.Process(target=time.sleep, args=(0,))
        process.start()
        process.join()
        started = time.monotonic()
        store = tmp_path / "whole.zarr"
        process = context.Process(target=fetch_and_build, args=(toml, tmp_path / "whole", store))
        process.start()
        process.join()
        takes = time.monotonic() - started
        assert Dataset(store).fingerprint == expected
        moments = random.Random(7)
        killed = 0
        for number in range(kills):
            # Three kills to each place: the later ones hit what is left to do.
            place = tmp_path / f"in{number // 3}"
            store = tmp_path / f"{number // 3}.zarr"
            process = context.Process(target=fetch_and_build, args=(toml, place, store))
            process.start()
            time.sleep(moments.uniform(0, takes))
            process.kill()
            process.join()
            killed += process.exitcode != 0
        assert killed >= hits
        for number in range(kills // 3):
            store = tmp_path / f"{number}.zarr"
            fetch_and_build(toml, tmp_path / f"in{number}", store)
            assert Dataset(store).fingerprint == expected
            assert verify_store(Dataset(store)).sound
