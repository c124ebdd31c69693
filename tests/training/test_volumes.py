from pathlib import Path

import numpy as np
import pytest
import torch

from dfdbench.errors import InputError
from dfdbench.methods.volume_net import levels_of
from dfdbench.training.cameras import train_on_cameras
from dfdbench.training.volume_examples import COUNT, Example
from dfdbench.training.volumes import CROP, CROPS, DEPTHS, VOLUME_NET, draw


def example(seed: int) -> Example:
    """Return an example whose costs tell its depth."""
    random = np.random.default_rng(seed)
    levels = np.kron(random.integers(0, 256, (8, 10)), np.ones((8, 8))).astype(np.int16)
    away = np.abs(levels[::2, ::2] - levels_of(COUNT)[:, None, None]) / 8
    roots = np.minimum(away * 51, 255).astype(np.uint8)
    return Example(
        roots,
        roots,
        np.full((32, 40), 60, np.uint8),
        random.normal(size=(64, 80)).astype(np.float16),
        np.where(random.random(levels.shape) < 0.1, -1, levels).astype(np.int16),
        np.zeros(COUNT, np.float32),
    )


def test_crops_follow_from_seed_and_step_alone() -> None:
    examples = [example(0), example(1)]
    first, again, other = (draw(examples, 3, step) for step in (5, 5, 6))
    assert all(torch.equal(one, two) for one, two in zip(first, again, strict=True))
    assert not torch.equal(first[-1], other[-1])
    assert first[0].shape == (CROPS, COUNT, 32, 32)
    assert first[-1].shape == (CROPS, 64, 64)
    assert CROP > 64


def test_however_a_crop_is_turned_costs_and_levels_lie_over_each_other() -> None:
    volume, *_, levels = draw([example(0)], 0, 0)
    cheapest = DEPTHS[volume.argmin(1)]
    truth = levels[:, ::2, ::2]
    known = truth >= 0
    assert ((cheapest - truth)[known].abs() <= 4.5).all()


def test_images_smaller_than_its_scales_are_refused(tmp_path: Path) -> None:
    whole = example(0)
    small = Example(
        whole.paths[:, :8],
        whole.roots[:, :8],
        whole.told[:8],
        whole.guide[:16],
        whole.levels[:16],
        whole.prior,
    )
    with pytest.raises(InputError, match="images of 16 pixels are too small"):
        train_on_cameras(VOLUME_NET, {"mine": [small]}, "made", tmp_path)
