from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.export import export_png
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import StoreError
from dfdbench.evaluation.evaluate import score_predictions
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.methods.baselines import Local
from tests.conftest import read_rgb, store_of, write_png
from tests.made_folder import FOLDER_TOML, SCENES, depth_in_millimetres, make_folder
from tests.made_source import MadeSource

local = Local()


def test_what_is_exported_builds_the_same_store_again(tiny_store: Dataset, tmp_path: Path) -> None:
    assert export_png(tiny_store, tmp_path / "png") == 11
    assert (tmp_path / "png/One/Illum1/Exp0/view1_lin_0.32_2.88.png").exists()
    assert not (tmp_path / "png/Three/Illum1/Exp1/view5.png").exists()
    again = store_of(tiny_store.manifest, tmp_path / "png", tmp_path / "again.zarr")
    assert again.fingerprint == tiny_store.fingerprint


def test_depth_that_levels_do_not_hold_is_exported_as_it_is(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "captures")
    for scene in SCENES:
        (folder / scene / "depth.png").unlink()
        np.save(folder / scene / "depth.npy", depth_in_millimetres().astype(np.float32))
    inverse, told = "linear in 1/z from 0.5 m to 5 m", "depth_unit = 0.001"
    for unit, was, then in (
        ("metres", told, ""),
        ("levels", "depth_ends = [900, 4200]", "depth_ends = [255, 1]"),
    ):
        text = FOLDER_TOML.replace(inverse, unit).replace("depth.png", "depth.npy")
        text, place = text.replace(told, was), tmp_path / unit
        manifest = parse_manifest(text.encode(), "mine-1.toml")
        store = store_of(manifest, folder, place / "one.zarr")
        assert export_png(store, place / "png") == export_png(store, place / "png") == 4
        for old, new in (("sharp", "capture1"), ("blurred", "capture1_defocus")):
            text = text.replace(f"{old}.png", f"{new}.png")
        text = text.replace(was, then)
        manifest = parse_manifest(text.encode(), "mine-1.toml")
        again = store_of(manifest, place / "png", place / "again.zarr")
        assert again.fingerprint == store.fingerprint
        with pytest.raises(StoreError, match=r"must not see .*depth\.npy"):
            export_png(store, place / "png", images_only=True)
        np.save(place / "png/desk/depth.npy", np.zeros((3, 3), np.float32))
        with pytest.raises(StoreError, match="holds something else"):
            export_png(store, place / "png")


def test_only_a_split_and_nothing_is_overwritten(tiny_store: Dataset, tmp_path: Path) -> None:
    assert export_png(tiny_store, tmp_path, "One") == 4
    assert not (tmp_path / "Two").exists()
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.png")}
    export_png(tiny_store, tmp_path, "One")
    assert times == {path: path.stat().st_mtime_ns for path in times}
    mine = tmp_path / "One/Illum1/Exp0/view1.png"
    write_png(mine, np.zeros((3, 3), np.uint8))
    before = mine.read_bytes()
    with pytest.raises(StoreError, match="holds something else"):
        export_png(tiny_store, tmp_path, "One")
    assert mine.read_bytes() == before


@pytest.mark.parametrize("captured", [True, False])
def test_pairs_by_other_axes_are_named_by_them(tmp_path: Path, captured: bool) -> None:
    manifest = find_manifest("realworld" if captured else "realworld-synthetic")
    random = np.random.default_rng(0)
    exposures = manifest.axes["exposure_ms"]
    shape = (len(exposures), 9, 11, 3)
    infocus, defocus = (random.integers(0, 256, shape).astype(np.uint8) for _ in range(2))
    depth = random.integers(1, 256, (9, 11)).astype(np.uint8)

    source = MadeSource(manifest, infocus, depth, defocus if captured else None, "k03")
    build_store(manifest, source, tmp_path / "s.zarr")
    store = Dataset(tmp_path / "s.zarr")
    assert export_png(store, tmp_path / "png") == len(exposures)
    written = {path.name for path in (tmp_path / "png/k03").iterdir()}
    blurred = "defocus" if captured else "lin_0.32_2.88"
    names = {f"exposure_ms{value}{end}.png" for value in exposures for end in ("", f"_{blurred}")}
    assert written == {"depth.png"} | names
    image = read_rgb(tmp_path / f"png/k03/exposure_ms20_{blurred}.png")
    assert np.array_equal(image, store.read(store.pairs("k03")[1]).defocus)


def test_images_alone_are_enough_for_the_scores_of_a_run(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    assert export_png(tiny_store, tmp_path / "images", "One", images_only=True) == 4
    written = list((tmp_path / "images").rglob("*.*"))
    assert sorted(path.name for path in written) == ["defocus.png"] * 4 + ["infocus.png"] * 4
    for path in (tmp_path / "images").rglob("infocus.png"):
        depth = tmp_path / "depth" / path.parent.relative_to(tmp_path / "images")
        depth.parent.mkdir(parents=True, exist_ok=True)
        np.save(f"{depth}.npy", local(read_rgb(path), read_rgb(path.with_name("defocus.png"))))
    scored = score_predictions(tmp_path / "depth", tiny_store, "One", tmp_path / "scored", "local")
    run = run_method(tiny_store, load_for(tiny_store, local, {}), "One", tmp_path / "run")
    assert [p.scores for p in scored.result.pairs] == [p.scores for p in run.result.pairs]
    export_png(tiny_store, tmp_path / "whole", "One")
    with pytest.raises(StoreError, match="which methods must not see"):
        export_png(tiny_store, tmp_path / "whole", "One", images_only=True)
