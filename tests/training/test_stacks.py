from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import torch

from dfdbench.datasets.captures import Capture, ImageFacts
from dfdbench.datasets.manifest import Pair
from dfdbench.methods.networks.weights import load_weights
from dfdbench.training import stacks
from tests.made_stacks import blurred_to
from tests.methods.made_planes import texture
from tests.training.test_cameras import train_on


def test_a_capture_s_images_are_put_in_order_of_the_focus() -> None:
    images = np.stack([np.full((4, 6, 3), grey, np.uint8) for grey in (9, 50, 10, 30)])
    focus = np.array([np.nan, 200.0, 20.0, 90.0])
    facts = ImageFacts(("infocus", "defocus", "defocus", "defocus"), focus_depth=focus)
    depth = np.full((4, 6), 80, np.float32)
    depth[0] = np.nan
    stack = stacks.stack_of(Capture(Pair("Desk", ()), images, depth, facts))
    assert stack.images[:, 0, 0, 0].tolist() == [10, 30, 50]
    assert stack.places.tolist() == [20, 90, 200]
    np.testing.assert_array_equal(stack.truth, depth)


@pytest.mark.slow
def test_rooms_are_seen_whole_and_are_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stacks, "CAMERAS", 2)
    monkeypatch.setattr(stacks, "_RAYS", 1)
    made = stacks.room_stacks(tmp_path)
    (tmp_path / "stack-01.npz").unlink()
    again = stacks.room_stacks(tmp_path)
    for name, (one,) in made.items():
        np.testing.assert_array_equal(one.images, again[name][0].images)
        np.testing.assert_array_equal(one.truth, again[name][0].truth)
        assert (np.diff(one.places) > 0).all()
        assert one.images.shape[1:3] == one.truth.shape
        # Rooms reach from 0.6 to 6 metres.
        assert 1 / 6.5 < np.nanmin(one.truth) < np.nanmax(one.truth) < 1 / 0.55


PLACES = (0.2, 0.5, 0.7, 1.1, 1.5)
train_stack_net = partial(train_on, stacks.STACK_NET)


@cache
def stack(seed: int, rows: int = 64) -> stacks.Stack:
    """Return a stack of two surfaces, a part of them unknown."""
    shape = (rows, 96)
    truth = np.full(shape, 0.3)
    truth[:, 48:] = 1.3
    images = [blurred_to(texture(seed, *shape), truth, place, 3.0) for place in PLACES]
    truth[:4] = np.nan
    return stacks.Stack(np.stack(images), np.float32(PLACES), truth.astype(np.float32))  # type: ignore[arg-type]


def test_crops_have_three_images_or_more_in_order_of_the_focus() -> None:
    seen = set()
    for step in range(30):
        images, focus, truth = stacks.draw([stack(0)], 0, step)
        assert truth.shape == (stacks.CROPS, 64, 64)
        assert torch.equal(images, stacks.draw([stack(0)], 0, step)[0])
        assert images.shape[:2] == focus.shape == (stacks.CROPS, focus.shape[1])
        assert (focus.diff() > 0).all()
        assert (focus[:, 0] == 0).all()
        torch.testing.assert_close(focus[:, -1], torch.full((stacks.CROPS,), 255.0))
        assert torch.isnan(truth).any()
        seen.add(focus.shape[1])
    assert seen == set(range(stacks.FEWEST, len(PLACES) + 1))


def test_however_a_crop_is_turned_images_and_truth_lie_over_each_other() -> None:
    for step in range(8):
        images, _, truth = stacks.draw([stack(0)], 0, step)
        near = truth > truth.nan_to_num(0).amax() / 2
        last = (images[:, -1] - images[:, -1].mean((1, 2), keepdim=True)).abs()
        assert last[near].mean() > last[~near & truth.isfinite()].mean()


@pytest.mark.slow
def test_it_learns_to_tell_two_surfaces_apart(tmp_path: Path) -> None:
    cameras = {"stack-00": [stack(0)], stacks.HELD_OUT[0]: [stack(1)]}
    path, card, log = train_stack_net(cameras, tmp_path, steps=40)
    network = load_weights(path, "stack-net")[0]
    with torch.inference_mode():
        error = stacks.error_of(network, stack(1))  # type: ignore[arg-type]
    assert card.further_scores["valid"]["nrmse"] == pytest.approx(error)
    assert list(log.scores[-1]) == ["step", stacks.HELD_OUT[0]]
    # A constant is off by 0.5 of 1.3 at the least.
    assert error < 0.25
