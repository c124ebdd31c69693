from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from dfdbench.errors import InputError
from dfdbench.methods.networks.weights import load_weights
from dfdbench.training.cameras import train_on_cameras
from dfdbench.training.stack_examples import Stack
from dfdbench.training.stacks import CROP, CROPS, FEWEST, HELD_OUT, STACK_NET, draw, error_of
from tests.made_stacks import blurred_to
from tests.methods.made_planes import texture

PLACES = (0.2, 0.5, 0.7, 1.1, 1.5)
train_stack_net = partial(train_on_cameras, STACK_NET)


def stack(seed: int, rows: int = 64) -> Stack:
    """Return a stack of two surfaces, a part of them unknown."""
    shape = (rows, 96)
    truth = np.full(shape, 0.3)
    truth[:, 48:] = 1.3
    images = [blurred_to(texture(seed, *shape), truth, place, 3.0) for place in PLACES]
    truth[:4] = np.nan
    return Stack(np.stack(images), np.float32(PLACES), truth.astype(np.float32))  # type: ignore[arg-type]


def test_crops_follow_from_seed_and_step_alone() -> None:
    stacks = [stack(0), stack(1)]
    first, again, other = (draw(stacks, 3, step) for step in (5, 5, 6))
    for one, two in zip(first, again, strict=True):
        assert torch.equal(one.nan_to_num(-1), two.nan_to_num(-1))
    assert not torch.equal(first[0].mean((1, 2, 3)), other[0].mean((1, 2, 3)))
    assert CROP > 64
    assert first[2].shape == (CROPS, 64, 64)


def test_crops_have_three_images_or_more_in_order_of_the_focus() -> None:
    seen = set()
    for step in range(30):
        images, focus, truth = draw([stack(0)], 0, step)
        assert images.shape[:2] == focus.shape == (CROPS, focus.shape[1])
        assert (focus.diff() > 0).all()
        assert (focus[:, 0] == 0).all()
        torch.testing.assert_close(focus[:, -1], torch.full((CROPS,), 255.0))
        assert torch.isnan(truth).any()
        seen.add(focus.shape[1])
    assert seen == set(range(FEWEST, len(PLACES) + 1))


def test_however_a_crop_is_turned_images_and_truth_lie_over_each_other() -> None:
    for step in range(8):
        images, _, truth = draw([stack(0)], 0, step)
        near = truth > truth.nan_to_num(0).amax() / 2
        last = (images[:, -1] - images[:, -1].mean((1, 2), keepdim=True)).abs()
        assert last[near].mean() > last[~near & truth.isfinite()].mean()


def test_it_learns_to_tell_two_surfaces_apart(tmp_path: Path) -> None:
    cameras = {"stack-00": [stack(0)], HELD_OUT[0]: [stack(1)]}
    path, card, log = train_stack_net(cameras, "made", tmp_path, steps=40)
    network = load_weights(path, "stack-net")[0]
    with torch.inference_mode():
        error = error_of(network, stack(1))  # type: ignore[arg-type]
    assert card.further_scores["valid"]["nrmse"] == pytest.approx(error)
    assert list(log.scores[-1]) == ["step", HELD_OUT[0]]
    # A constant is off by 0.5 of 1.3 at the least.
    assert error < 0.25


def test_images_smaller_than_its_scales_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="images of 16 pixels are too small"):
        train_stack_net({"mine": [stack(0, rows=16)]}, "made", tmp_path)
