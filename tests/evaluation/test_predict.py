import shutil
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray
from numpy.typing import NDArray

import dfdbench
from dfdbench.blur.formation import magnify
from dfdbench.blur.law import BlurLaw
from dfdbench.blur.light import decode, encode
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.building.build import build_store
from dfdbench.building.export import export_png
from dfdbench.building.sources import open_source
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, MethodError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.predict import DepthPredictor, predict
from dfdbench.methods.view_change import ViewChange
from tests.conftest import read_rgb, write_png
from tests.made_folder import FOLDER_TOML, SCENES, make_folder
from tests.made_stack_folder import STACK_TOML, make_stacks

Image = NDArray[np.uint8]
LENS = """
focal_length = 0.025
defocus_f_number = 2.8
focus_distance = 1.6
pixel_pitch = 3e-5
[scale]
near = 0.5
far = 5.0
"""


@pytest.fixture(scope="module")
def pair() -> tuple[Image, Image, Image]:
    """A random texture, fine and coarse, on two planes, its defocus image, and the depth."""
    noise = np.random.default_rng(1).uniform(0, 255, (160, 200, 3))
    fine, coarse = (np.asarray(cv2.GaussianBlur(noise, (0, 0), sigma)) for sigma in (1.5, 8))
    image = np.clip(128 + (fine - fine.mean()) * 1.5 + (coarse - coarse.mean()) * 8, 10, 245)
    depth = np.where(np.arange(200) < 100, 60, 190) * np.ones((160, 1), int)
    sharp, levels = image.astype(np.uint8), depth.astype(np.uint8)
    return sharp, synthesize(sharp, levels, RECIPES["published"]), levels


def test_depth_is_what_the_method_gives(pair: tuple[Image, Image, Image], tmp_path: Path) -> None:
    sharp, blurred, depth = pair
    write_png(tmp_path / "sharp.png", sharp)
    write_png(tmp_path / "blurred.png", blurred)
    files = tmp_path / "sharp.png", tmp_path / "blurred.png"
    found = predict("local", files, "published", align=False)
    ready = dfdbench.load_method("local", recipe="published")
    assert np.array_equal(found, ready(sharp, blurred))
    assert np.array_equal(found, predict(ready, files, align=False))
    with pytest.raises(MethodError, match="not an RGB image of 8 bits"):
        ready(sharp / 255, blurred / 255)
    for one in (ready, dfdbench.load_method("shape-from-focus")):
        with pytest.raises(MethodError, match="neither two images nor a stack"):
            one(sharp)
    assert np.abs(found - depth)[:, 20:-20].mean() < 20


def test_what_is_no_photograph_or_lacking_is_said(pair: tuple[Image, Image, Image]) -> None:
    grey = np.ones((8, 9), np.uint8)
    wrong: list[tuple[Any, str]] = [
        ([np.ones((8, 9, 3))] * 2, "no photograph: expected uint8 or uint16.*float64"),
        ([np.ones((8, 9, 4), np.uint8)] * 2, r"no photograph.*shape \(8, 9, 4\)"),
        ([grey, grey.astype(np.uint16)], "types of pixels.*uint8 and uint"),
        ([grey], "neither two photographs nor a stack.*1 image"),
        ("folder", "neither two photographs nor a stack.*str"),
        ((pair[0], pair[1][1:]), "differ in size"),
    ]
    for images, says in wrong:
        with pytest.raises(InputError, match=says):
            predict("local", images, "published", align=False)
    with pytest.raises(MethodError, match="not known well enough"):
        predict("local", pair[:2], {"focal_length": 0.025})
    with pytest.raises(MethodError, match="needs a focal stack, and this is a pair"):
        predict("shape-from-focus", pair[:2])
    with pytest.raises(MethodError, match="how sure it is, and nothing says from what"):
        predict("local", pair[:2], "published", parameters={"sure": True})


def test_grey_photographs_are_as_good(pair: tuple[Image, Image, Image]) -> None:
    sharp, blurred = (image[..., 1] for image in pair[:2])
    found = predict("local", (sharp, blurred), "published")
    alike = np.dstack([sharp] * 3), np.dstack([blurred] * 3)
    assert np.array_equal(found, predict("local", alike, "published"))


def test_photographs_are_laid_on_each_other(pair: tuple[Image, Image, Image]) -> None:
    sharp, blurred, depth = pair
    moved = np.clip(np.roll(blurred, (3, -4), axis=(0, 1)) * 0.9, 0, 255).astype(np.uint8)
    inner = np.s_[20:-20, 20:-20]

    def error(answer: NDArray[Any]) -> float:
        return float(np.abs(answer - depth)[inner].mean())

    straight = error(predict("local", (sharp, blurred), "published"))
    aligned = DepthPredictor("local", "published")(sharp, moved)
    as_is = error(predict("local", (sharp, moved), "published", align=False))
    assert error(aligned.depth) < straight + 10 < as_is
    assert "brightness" in aligned.found
    assert DepthPredictor("local", "published")(sharp, blurred).found == ""


def test_a_change_of_view_is_undone_once(pair: tuple[Image, Image, Image], tmp_path: Path) -> None:
    sharp, blurred, _ = pair
    larger = np.rint(np.clip(magnify(blurred.astype(float), [0.02] * 3), 0, 255)).astype(np.uint8)
    recipe = RECIPES["published"]
    law = BlurLaw(tuple(recipe.sigmas[::-1].tolist()), similarity=(0.0, 0.0, 0.0, 0.02))
    file = tmp_path / "law.toml"
    file.write_text(law.as_toml())
    found = DepthPredictor("local", file)(sharp, larger)
    assert found.found == "the law says of the defocus image: 2.00 % larger; that is taken out"
    alone = DepthPredictor("local", file, align=False)(sharp, larger)
    assert np.array_equal(found.depth, alone.depth)


def test_a_fall_off_that_the_law_knows_hides_no_move_and_no_gain(
    pair: tuple[Image, Image, Image],
) -> None:
    sharp, blurred, depth = pair
    falloff = ((1.0, 0.5),) * 3
    law = BlurLaw(tuple(RECIPES["published"].sigmas[::-1].tolist()), falloff=falloff)
    fallen = ViewChange(falloff=falloff).light_at(blurred.shape)
    moved = np.roll(blurred, (3, -4), axis=(0, 1)).astype(float)
    dark = np.rint(encode(decode(moved) * 0.8 * fallen)).astype(np.uint8)
    found = DepthPredictor("local", law)(sharp, dark)
    assert "moved by up to" in found.found
    assert "differ in brightness" in found.found
    plain = DepthPredictor("local", "published")(sharp, dark)
    still = np.rint(encode(decode(blurred.astype(float)) * fallen)).astype(np.uint8)
    said = DepthPredictor("local", "published")(sharp, still).found
    assert "darker at the corners than in the middle; falloff in a lens" in said
    inner = np.s_[20:-20, 20:-20]
    errors = [np.abs(one.depth - depth)[inner].mean() for one in (found, plain)]
    assert errors[0] < 0.5 * errors[1]


def light(infocus: Image, defocus: Image) -> NDArray[np.float32]:
    return np.asarray(defocus.mean(axis=2), np.float32)


def test_photographs_are_matched_as_those_of_the_run_s_data_set(tmp_path: Path) -> None:
    folder, falloff = make_folder(tmp_path / "set"), [[1.0, 0.5]] * 3
    for file in folder.glob("*/blurred.png"):
        image = read_rgb(file)
        dark = decode(image.astype(float)) * ViewChange(
            falloff=tuple(map(tuple, falloff))
        ).light_at(image.shape)
        write_png(file, np.rint(encode(dark)).astype(np.uint8)[..., ::-1])
    files = f'align = "translation"\nmatch_gain = true\nflat_field = {falloff}\n\n[table]'
    manifest = parse_manifest(FOLDER_TOML.replace("[table]", files).encode(), "mine-1.toml")
    build_store(manifest, open_source(manifest, folder), tmp_path / "mine.zarr")
    store = Dataset(tmp_path / "mine.zarr")
    run = dfdbench.run(light, store, out=tmp_path / "run")
    kept = store.captures("lamp")[0]
    raw = folder / "lamp/sharp.png", folder / "lamp/blurred.png"
    for images in (raw, (kept.infocus, kept.defocus)):
        assert np.array_equal(predict(light, images, run), light(kept.infocus, kept.defocus))
    shutil.rmtree(tmp_path / "mine.zarr")
    with pytest.raises(InputError, match="not known here"):
        predict(light, raw, tmp_path / "run")


def test_levels_grow_as_those_of_the_run_s_data_set(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "set")
    text = FOLDER_TOML.replace("depth_unit = 0.001", "depth_ends = [1000.0, 4000.0]")
    text = text.replace('"nearness"', '"distance"').replace(
        "[depth.scale]\nnear = 0.5\nfar = 5.0", ""
    )
    manifest = parse_manifest(text.encode(), "mine-1.toml")
    build_store(manifest, open_source(manifest, folder), tmp_path / "mine.zarr")
    dfdbench.run(light, Dataset(tmp_path / "mine.zarr"), out=tmp_path / "run")
    predictor = DepthPredictor(light, tmp_path / "run")
    assert predictor.meaning.startswith("depth levels from 0 (near) to 255 (far)")


def test_images_that_use_few_of_their_bits_are_told(pair: tuple[Image, Image, Image]) -> None:
    images: Any = pair[0].astype(np.uint16) * 16, pair[1].astype(np.uint16) * 16
    with pytest.warns(UserWarning, match="16 bits hold 12 at most"):
        predict("local", images, "published")
    roles = {"role": ("image", ["infocus", "defocus"])}
    stack = xarray.DataArray(np.stack(images), roles, ("image", "y", "x", "channel"))
    with pytest.warns(UserWarning, match="16 bits hold 12 at most"):
        predict("local", stack, "published")


def test_a_run_lends_what_its_fit_learned(few_demo: Dataset, tmp_path: Path) -> None:
    method = load_for(few_demo, "local", {"window": 5})
    loaded = dfdbench.load_method("local", window=5)
    run = dfdbench.run(loaded, few_demo, out=tmp_path / "run")
    images = few_demo.read(few_demo.pairs("test")[0])
    for camera in (run, tmp_path / "run"):
        depth = predict(None, (images.infocus, images.defocus), camera, align=False)
        assert np.array_equal(depth, method.predict(images.infocus, images.defocus))
    with pytest.raises(MethodError, match=r"of local, not of graph-cuts"):
        DepthPredictor("graph-cuts", tmp_path / "run")


def test_a_run_s_files_run_no_code_that_nobody_named(few_demo: Dataset, tmp_path: Path) -> None:
    (tmp_path / "theirs.py").write_text(
        f"open({str(tmp_path / 'ran')!r}, 'a').close()\n"
        "def predict(infocus, defocus):\n    return infocus[..., 0] * 1.0\n"
    )
    entry = f"{tmp_path / 'theirs.py'}:predict"
    dfdbench.run(entry, few_demo, limit=1, out=tmp_path / "run")
    (tmp_path / "ran").unlink()
    with pytest.raises(MethodError, match=r"run only if you name it.*\nFix: .*--method") as told:
        DepthPredictor(None, tmp_path / "run")
    assert not (tmp_path / "ran").exists()
    assert entry in str(told.value)
    DepthPredictor(entry, tmp_path / "run")
    assert (tmp_path / "ran").exists()


def test_a_lens_says_what_levels_are(pair: tuple[Image, Image, Image], tmp_path: Path) -> None:
    (tmp_path / "lens.toml").write_text(LENS)
    predictor = DepthPredictor("local", tmp_path / "lens.toml")
    assert predictor.meaning.startswith("depth levels from 0 (far) to 255 (near)")
    assert predictor.meaning.endswith("level 1 is 5 m, level 255 is 0.5 m")
    turned = LENS + "near_level = 1\nfar_level = 255\n"
    (tmp_path / "turned.toml").write_text(turned)
    said = DepthPredictor("local", tmp_path / "turned.toml").meaning
    assert said.startswith("depth levels from 0 (near) to 255 (far)")
    assert predictor(*pair[:2]).depth.shape == pair[2].shape


def test_a_run_that_was_given_a_lens_lends_it(few_demo: Dataset, tmp_path: Path) -> None:
    (tmp_path / "lens.toml").write_text(LENS)
    given, run = {"recipe": str(tmp_path / "lens.toml")}, tmp_path / "run"
    dfdbench.run("local", few_demo, limit=1, parameters=given, out=run)
    images = few_demo.captures("test")[0]
    lent, named = (DepthPredictor("local", camera) for camera in (run, tmp_path / "lens.toml"))
    assert lent.meaning == named.meaning
    pair = images.infocus, images.defocus
    np.testing.assert_array_equal(lent(*pair).depth, named(*pair).depth)


def test_a_run_that_took_its_set_s_lens_lends_it(tmp_path: Path) -> None:
    lens = LENS.partition("[scale]")[0]
    text = FOLDER_TOML.replace("[table]", f"[rig]{lens}\n[table]")
    manifest, folder = parse_manifest(text.encode(), "mine-1.toml"), make_folder(tmp_path / "set")
    build_store(manifest, open_source(manifest, folder), tmp_path / "mine.zarr")
    store = Dataset(tmp_path / "mine.zarr")
    dfdbench.run("local", store, parameters={"recipe": "rig"}, out=tmp_path / "run")
    (tmp_path / "lens.toml").write_text(LENS)
    places = tmp_path / "run", tmp_path / "lens.toml"
    lent, named = (DepthPredictor("local", place, align=False) for place in places)
    images = store.captures("lamp")[0]
    pair = images.infocus, images.defocus
    np.testing.assert_array_equal(lent(*pair).depth, named(*pair).depth)


def test_a_run_tells_how_its_set_s_captures_become_pairs(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "pairs")
    for number, name in enumerate(product(SCENES, ("sharp", "blurred"))):
        (folder / f"{'/'.join(name)}.png").rename(folder / name[0] / f"IMG_{number}.png")
    roles = "".join(f'[[files.image]]\nrole = "{role}"\n' for role in ("infocus", "defocus"))
    patterns = 'infocus = "{scene}/sharp.png"\ndefocus = "{scene}/blurred.png"'
    pairs = FOLDER_TOML.replace("[table]", f"{roles}\n[table]")
    pairs = pairs.replace(patterns, 'images = "{scene}/IMG_{image}.png"')
    stacks = STACK_TOML.replace("[axes]", "pair_images = [2, 0]\n[axes]")
    for toml, source in ((pairs, folder), (stacks, make_stacks(tmp_path / "stacks"))):
        manifest = parse_manifest(toml.encode(), "mine-1.toml")
        place = tmp_path / f"{source.name}.zarr"
        build_store(manifest, open_source(manifest, source), place)
        store = Dataset(place)
        run = dfdbench.run("s-transform", store, limit=1, out=tmp_path / f"{source.name}-run")
        capture = store.captures("test")[0]
        images = (capture.infocus, capture.defocus) if source == folder else capture.stack
        # The defocus image is darker, and the manifest does not want that matched.
        depth = manifest.depth.of_unit(predict(None, images, run), "levels")
        np.testing.assert_array_equal(depth, run.images(capture.pair.id)[1])
    two = capture.two_of([2, 0]).stack
    np.testing.assert_array_equal(predict(None, two, run), predict(None, capture.stack, run))


def test_an_exported_stack_says_which_two_images_a_method_of_pairs_gets(tmp_path: Path) -> None:
    toml = STACK_TOML.replace("[axes]", "pair_images = [3, 1]\n[axes]")
    manifest = parse_manifest(toml.encode(), "mine-1.toml")
    source = open_source(manifest, make_stacks(tmp_path / "mine"))
    build_store(manifest, source, tmp_path / "mine.zarr")
    store = Dataset(tmp_path / "mine.zarr")
    export_png(store, tmp_path / "png", "test", images_only=True)
    pair = store.pairs("test")[0]
    seen = DepthPredictor(lambda infocus, defocus: infocus[..., 0] / 2.0 + defocus[..., 0] / 2.0)
    found = seen.of_files([tmp_path / "png" / pair.id]).depth
    both = store.read(pair).images[[3, 1], ..., 0]
    np.testing.assert_array_equal(found, both.mean(axis=0, dtype=np.float32))


def test_the_unit_is_known_before_any_map_is_made(tmp_path: Path) -> None:
    (tmp_path / "stack.json").write_text('{"attributes": {"unit": "metres"}}')
    predictor = DepthPredictor("shape-from-focus")
    predictor.settle_unit([(tmp_path,)])
    assert predictor.unit == "metres"
    with pytest.raises(InputError, match="others not"):
        predictor.settle_unit([(tmp_path,), (tmp_path, tmp_path)])
