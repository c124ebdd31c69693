import hashlib
from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import OF_PATCHES
from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.check import made_pair
from dfdbench.training import crops
from dfdbench.training.configuration import Expansion

SMALL_BLUR = BlurRecipe(0.3, 0.005, kernel_size=7)


def of_one(infocus: np.ndarray, defocus: np.ndarray, depth: np.ndarray) -> crops.TrainingImages:
    pixels = np.concatenate([infocus, defocus], axis=2).transpose(2, 0, 1).copy()
    return crops.TrainingImages([torch.from_numpy(pixels)], [torch.from_numpy(depth).short()])


@pytest.fixture
def images(tiny_store: Dataset) -> crops.TrainingImages:
    return crops.TrainingImages.read(tiny_store, tiny_store.pairs("test"), ignore_unknown=False)


def test_images_are_those_of_the_store(tiny_store: Dataset, images: crops.TrainingImages) -> None:
    pairs = tiny_store.pairs("test")
    pair = tiny_store.read(pairs[2])
    assert len(images.pixels) == len(pairs) == 7
    assert np.array_equal(images.pixels[2][:3].permute(1, 2, 0).numpy(), pair.infocus)
    assert np.array_equal(images.pixels[2][3:].permute(1, 2, 0).numpy(), pair.defocus)
    assert np.array_equal(images.levels[2].numpy(), pair.levels)
    assert images.levels[0] is images.levels[1]  # exposures of a view share a depth map
    read = [tiny_store.read(each) for each in pairs]
    pixels = [np.concatenate([each.infocus, each.defocus], 2).reshape(-1, 6) for each in read]
    assert images.channel_means() == pytest.approx(np.concatenate(pixels).mean(0), abs=1e-3)
    # Unknown pixels may be left out.
    found = crops.TrainingImages.read(tiny_store, pairs, ignore_unknown=True).levels[2].numpy()
    assert (found[~pair.valid] == crops.IGNORED).all()
    assert (found[pair.valid] == pair.levels[pair.valid]).all()


def test_only_depth_maps_of_one_shape_are_shared() -> None:
    made = {}
    for shape in ((20, 30), (30, 20)):
        image, depth = np.zeros((*shape, 3), np.uint8), np.full(shape, 9, np.uint8)
        made[shape] = made_pair(image, image, depth, depth > 0)
    store: Any = SimpleNamespace(read=made.get, manifest=SimpleNamespace(pair_images=None))
    pairs: Any = tuple(made)
    read = crops.TrainingImages.read(store, pairs, ignore_unknown=False)
    assert [levels.shape for levels in read.levels] == [*made]


def test_a_patch_comes_in_eight_orientations_depth_alike(images: crops.TrainingImages) -> None:
    pixels, levels = crops.Cropper(images, 16, 2, "eight", 0.0, 5).draw(3)
    assert pixels.shape == (16, 6, 16, 16)
    assert levels.shape == (16, 16, 16)
    turned = {crops.oriented(levels[0], orientation).numpy().tobytes() for orientation in range(8)}
    assert {level.numpy().tobytes() for level in levels[:8]} == turned
    assert len(turned) == 8
    # Each depth patch belongs to the pixels it comes with: both lie at one place of one image.
    for patch, level in zip(pixels, levels, strict=True):
        wholes = zip(images.pixels, images.levels, strict=True)
        assert any(found_at(whole.float(), patch, depth, level) for whole, depth in wholes)


def found_at(
    whole: torch.Tensor, patch: torch.Tensor, depth: torch.Tensor, level: torch.Tensor
) -> bool:
    for orientation in range(8):
        image, levels = crops.oriented(whole, orientation), crops.oriented(depth, orientation)
        places = (image[0].unfold(0, 16, 1).unfold(1, 16, 1) == patch[0]).all(-1).all(-1)
        for top, left in torch.nonzero(places).tolist():
            here = slice(top, top + 16), slice(left, left + 16)
            alike = torch.equal(image[:, here[0], here[1]], patch)
            if alike and torch.equal(levels[here].long(), level):
                return True
    return False


def test_the_basic_expansion_mirrors_by_two_fair_coins(images: crops.TrainingImages) -> None:
    # 5.2.1: left-right, then up-down, each with a probability of 50 %; nothing is turned.
    cropper = crops.Cropper(images, 16, 4000, "basic", 0.0, 1)
    place = cropper.places(0)[0]
    whole = images.levels[place.index][place.top : place.top + 16, place.left : place.left + 16]
    mirrored = [whole, whole.flip(1), whole.flip(0), whole.flip(0, 1)]
    expected = {level.numpy().tobytes() for level in mirrored}
    assert {crops.oriented(whole, number).numpy().tobytes() for number in (0, 2, 4, 6)} == expected
    assert crops.oriented(whole, place.orientation).numpy().tobytes() in expected
    counts = np.bincount([place.orientation for place in cropper.places(0)], minlength=8)
    assert (counts[1::2] == 0).all()
    assert counts[::2] == pytest.approx([1000] * 4, abs=120)


def test_noise_has_its_deviation_and_stays_in_range(images: crops.TrainingImages) -> None:
    clean, noisy = (crops.Cropper(images, 16, 64, "one", n, 1).draw(0)[0] for n in (0.0, 3.0))
    inside = (clean > 15) & (clean < 240)
    difference = (noisy - clean)[inside]
    assert float(difference.std()) == pytest.approx(3, rel=0.03)
    assert float(difference.mean()) == pytest.approx(0, abs=0.05)
    assert 0 <= float(noisy.min()) <= float(noisy.max()) <= 255


def test_redrawn_depths_lie_in_their_range_and_keep_what_is_unknown() -> None:
    random, redraw = np.random.default_rng(4), crops.Redraw(SMALL_BLUR, 60, 160, 0.5, 0)
    depth = np.full((22, 22), 90, np.uint8)
    depth[:5] = 0
    means = []
    for _ in range(200):
        redrawn = redraw.levels(depth, redraw.choose(random))
        assert np.array_equal(redrawn == 0, depth == 0)
        means.append(redrawn[depth > 0].mean())
    assert 55 < min(means) < 75
    assert 145 < max(means) < 165


def test_redrawn_patches_are_blurred_with_what_lies_around_them() -> None:
    # No tilt and one level: patches of the image that was blurred whole, up to their edges.
    infocus = np.random.default_rng(5).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    depth = np.full((40, 40), 100, np.uint8)
    images = of_one(infocus, synthesize(infocus, depth, SMALL_BLUR), depth)
    redraw = crops.Redraw(SMALL_BLUR, 100, 100, 0.0, 0)
    pixels, levels = crops.Cropper(images, 16, 6, "one", 0.0, 1, redraw).draw(0)
    for patch, level in zip(pixels, levels, strict=True):
        assert found_at(images.pixels[0].float(), patch, images.levels[0], level)


def drawn_on_tracks(names: list[str], seed: int, step: int) -> tuple[torch.Tensor, torch.Tensor]:
    infocus = np.random.default_rng(5).integers(40, 200, (64, 64, 3)).astype(np.uint8)
    depth = np.full((64, 64), 100, np.uint8)
    redraw = crops.Redraw(SMALL_BLUR, 60, 160, 0.5, 0, crops.severities_of(names))
    images = of_one(infocus, infocus, depth)
    return crops.Cropper(images, 16, 40, "one", 1.0, seed, redraw).draw(step)


def test_patches_on_random_tracks_follow_from_seed_and_step_alone() -> None:
    def drawn(seed: int, step: int) -> bytes:
        pixels, levels = drawn_on_tracks(list(OF_PATCHES), seed, step)
        return bytes(pixels.numpy().tobytes() + levels.numpy().tobytes())

    assert drawn(1, 7) == drawn(1, 7)
    assert len({drawn(1, 7), drawn(1, 8), drawn(2, 7)}) == 3


def test_each_patch_has_the_gain_that_its_track_draws() -> None:
    pixels, _ = drawn_on_tracks(["gain"], 1, 7)
    gains = pixels[:, 3:].mean((1, 2, 3)) / pixels[:, :3].mean((1, 2, 3))
    assert float(gains.min()) < 0.97
    assert float(gains.max()) > 1.03
    # Severity 0 is among them.
    assert int(((gains - 1).abs() < 0.005).sum()) >= 5


def test_without_tracks_patches_are_drawn_as_before() -> None:
    random = np.random.default_rng(3)
    images = crops.TrainingImages(
        [torch.from_numpy(random.integers(0, 256, (6, 40, 40)).astype(np.uint8))],
        [torch.from_numpy(random.integers(1, 256, (40, 40)).astype(np.int16))],
    )
    redraw = crops.Redraw(SMALL_BLUR, 60, 160, 0.5, 0)
    pixels, levels = crops.Cropper(images, 16, 4, "one", 0.0, 9, redraw).draw(5)
    digest = hashlib.sha256(pixels.numpy().tobytes() + levels.numpy().tobytes()).hexdigest()
    assert digest.startswith("72a110f0ed1abf12")


def test_tracks_and_severities_are_drawn_alike() -> None:
    grey = np.full((40, 40, 3), 90, np.uint8)
    images = of_one(grey, grey, np.full((40, 40), 100, np.uint8))
    redraw = crops.Redraw(SMALL_BLUR, 60, 160, 0.5, 0, crops.severities_of(OF_PATCHES))
    places = crops.Cropper(images, 4, 2800, "one", 0.0, 0, redraw).places(0)
    drawn = [place.degradation for place in places if place.degradation]
    assert len(drawn) == 2800
    counts = Counter((one.track.name, one.severity) for one in drawn)
    assert counts.keys() == {(name, severity) for name in OF_PATCHES for severity in range(4)}
    assert 60 < min(counts.values()) < max(counts.values()) < 140


@pytest.mark.parametrize("name", OF_PATCHES)
def test_a_patch_cut_with_its_margin_is_that_of_the_whole_image(name: str) -> None:
    # Where noise is drawn for each pixel by its place in the image, patch and whole differ.
    image = np.random.default_rng(2).integers(60, 190, (120, 120, 3)).astype(np.uint8)
    depth = np.tile(np.repeat(np.array([80, 140], np.uint8), 60), (120, 1))
    *_, one = crops.severities_of([name])
    assert one.severity == 3
    margin = crops.margin_of(RECIPES["published"], one)
    _, whole = form_pair(image, depth, RECIPES["published"], one, "training/1/2/3")
    inner, around = slice(60 - 8, 60 + 8), slice(60 - 8 - margin, 60 + 8 + margin)
    cut = image[around, around], depth[around, around]
    _, patch = form_pair(*cut, RECIPES["published"], one, "training/1/2/3")
    difference = patch[margin:-margin, margin:-margin].astype(int) - whole[inner, inner]
    noisy = name in ("noise", "camera")
    assert abs(difference.mean()) < (5 if noisy else 0.01)
    assert noisy or np.abs(difference).max() <= 1


STEPS = 5


def test_every_pixel_is_counted_as_often_as_it_was_trained_on() -> None:
    # Images whose first channel is the image's number, levels that number their pixels.
    shapes = [(14, 17), (15, 16), (13, 13)]
    pixels = [torch.full((6, *shape), n, dtype=torch.uint8) for n, shape in enumerate(shapes)]
    numbers = [torch.arange(rows * columns).reshape(rows, columns) for rows, columns in shapes]
    images = crops.TrainingImages(pixels, [each.short() for each in numbers])
    expansions: dict[Expansion, int] = {"basic": 1, "eight": 8}
    for expansion, orientations in expansions.items():
        cropper = crops.Cropper(images, 6, 3, expansion, 1.0, 9)
        drawn = crops.selections_of(cropper, ("a", "b", "c"), STEPS)
        by_hand = [np.zeros(levels.numel(), int) for levels in images.levels]
        quiet = crops.Cropper(images, 6, 3, expansion, 0.0, 9)
        for step in range(STEPS):
            for patch, places in zip(*quiet.draw(step), strict=True):
                by_hand[int(patch[0, 0, 0])][places.numpy().ravel()] += 1
        for number, expected in enumerate(by_hand):
            assert (orientations * drawn.uses(number).ravel() == expected).all()
        assert drawn.patches.sum() == 3 * STEPS
        rows = drawn.rows()
        assert [row["pair"] for row in rows] == ["a", "b", "c"]
        assert [row["patches"] for row in rows] == drawn.patches.tolist()
        assert rows[0]["pixel_most"] == drawn.uses(0).max()


def test_with_other_depths_the_patch_counts_and_not_what_its_blur_depends_on() -> None:
    image = np.random.default_rng(6).integers(0, 256, (20, 24, 3)).astype(np.uint8)
    images = of_one(image, image, np.full((20, 24), 90))
    redraw = crops.Redraw(SMALL_BLUR, 60, 160, 0.5, 0)
    cropper = crops.Cropper(images, 6, 40, "one", 0.0, 2, redraw)
    drawn = crops.selections_of(cropper, ("a",), STEPS)
    infocus = images.pixels[0][:3].float()
    for step in range(STEPS):
        for place, patch in zip(cropper.places(step), cropper.draw(step)[0], strict=True):
            here = infocus[:, place.top : place.top + 6, place.left : place.left + 6]
            assert torch.equal(patch[:3].sum(), here.sum())
    assert drawn.uses(0).sum() == 40 * STEPS * 36
    assert drawn.uses(0)[:3].sum() == 0 < drawn.uses(0)[3].sum()
