from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.training.configuration import Expansion
from dfdbench.training.crops import Cropper, Redraw, TrainingImages
from dfdbench.training.selections import selections_of

STEPS = 5


def numbered_images() -> TrainingImages:
    """Images whose first channel is the image's number, levels that number their pixels."""
    shapes = [(14, 17), (15, 16), (13, 13)]
    pixels = [
        torch.full((6, *shape), number, dtype=torch.uint8) for number, shape in enumerate(shapes)
    ]
    levels = [torch.arange(rows * columns).reshape(rows, columns) for rows, columns in shapes]
    return TrainingImages(pixels, [level.short() for level in levels])


@pytest.mark.parametrize("expansion", ["one", "basic", "eight"])
def test_every_pixel_is_counted_as_often_as_it_was_trained_on(expansion: Expansion) -> None:
    images = numbered_images()
    cropper = Cropper(images, 6, 3, expansion, 1.0, 9)
    drawn = selections_of(cropper, ("a", "b", "c"), STEPS)
    by_hand = [np.zeros(levels.numel(), int) for levels in images.levels]
    quiet = Cropper(images, 6, 3, expansion, 0.0, 9)
    for step in range(STEPS):
        pixels, levels = quiet.draw(step)
        for patch, places in zip(pixels, levels, strict=True):
            by_hand[int(patch[0, 0, 0])][places.numpy().ravel()] += 1
    orientations = 8 if expansion == "eight" else 1
    for number, expected in enumerate(by_hand):
        assert (orientations * drawn.uses(number).ravel() == expected).all()
    assert drawn.patches.sum() == 3 * STEPS
    rows = drawn.rows()
    assert [row["pair"] for row in rows] == ["a", "b", "c"]
    assert [row["patches"] for row in rows] == drawn.patches.tolist()
    assert rows[0]["pixel_most"] == drawn.uses(0).max()


def test_with_other_depths_the_patch_counts_and_not_what_its_blur_depends_on() -> None:
    images = TrainingImages(
        [torch.randint(0, 256, (6, 20, 24), dtype=torch.uint8)],
        [torch.full((20, 24), 90, dtype=torch.int16)],
    )
    redraw = Redraw(BlurRecipe(0.3, 0.005, kernel_size=7), 60, 160, 0.5, 0)
    cropper = Cropper(images, 6, 40, "one", 0.0, 2, redraw)
    drawn = selections_of(cropper, ("a",), STEPS)
    infocus = images.pixels[0][:3].float()
    for step in range(STEPS):
        for place, patch in zip(cropper.places(step), cropper.draw(step)[0], strict=True):
            here = infocus[:, place.top : place.top + 6, place.left : place.left + 6]
            assert torch.equal(patch[:3].sum(), here.sum())
    assert drawn.uses(0).sum() == 40 * STEPS * 36
    assert drawn.uses(0)[:3].sum() == 0 < drawn.uses(0)[3].sum()
