"""Which pixels of training pairs count, and what is looked at of them."""

import numpy as np

from dfdbench.methods.calibration_parts import KERNEL_SIZE, Way, parts_of
from dfdbench.methods.width_curve import LADDER
from tests.methods.made_planes import MadePair, pair_of, plane, texture


def test_pixels_near_a_jump_the_border_or_the_unknown_do_not_count() -> None:
    depth = np.full((80, 120), 90, np.uint8)
    depth[:, 60:] = 160
    made = pair_of(texture(0, 80, 120), depth)
    valid = made.valid.copy()
    valid[40, 30] = False
    (part,) = parts_of([MadePair(made.infocus, made.defocus, depth, valid)])
    margin = KERNEL_SIZE // 2
    assert not part.counts[:margin].any()
    assert not part.counts[:, -margin:].any()
    assert not part.counts[:, 55:65].any()
    assert not part.counts[36:45, 26:35].any()
    assert part.counts[20:30, 20:50].all()
    assert part.counts[20:60, 70:100].all()


def test_pixels_that_may_be_cut_off_above_do_not_count() -> None:
    made = plane(120)
    bright = np.maximum(made.defocus, 254)
    (part,) = parts_of([MadePair(made.infocus, bright, made.depth, made.valid)])
    assert not part.counts.any()


def test_some_pairs_stand_for_many_and_a_part_for_a_large_one() -> None:
    looked_at = []

    class Pairs(list[MadePair]):
        def __getitem__(self, index):  # type: ignore[no-untyped-def]
            looked_at.append(index)
            return super().__getitem__(index)

    pairs = Pairs([plane(100, seed, 40, 400) for seed in range(40)])
    parts = parts_of(pairs)
    assert len(parts) == len(looked_at) == 16
    assert looked_at == sorted(looked_at)
    assert (looked_at[0], looked_at[-1]) == (0, 39)
    assert {part.infocus.shape for part in parts} == {(40, 320, 1)}


def test_the_width_that_blurred_a_plane_leaves_least() -> None:
    made = plane(100, 3, 96, 96)
    (part,) = parts_of([made])
    sample = part.sample(Way())
    left = [float(np.square(trial - sample.aim).mean()) for trial in sample.trials(Way())]
    # As published: 0.32 + 0.01125 pixels a level, farther is blurred more.
    assert abs(LADDER[int(np.argmin(left))] - (0.32 + 0.01125 * 155)) < 0.12


def test_a_level_seen_on_bare_surfaces_alone_does_not_count() -> None:
    made = plane(100, 3, 96, 96)
    # Of what is left of the texture rounding keeps a grey level here and there.
    bare = np.rint(120 + (made.infocus - 120.0) / 100).astype(np.uint8)
    hidden = pair_of(bare, np.full(bare.shape[:2], 20, np.uint8))
    textured, flat = parts_of([made, hidden])
    assert np.unique(flat.infocus).size > 1
    assert textured.counts.sum() == (96 - 2 * (KERNEL_SIZE // 2)) ** 2
    assert not flat.counts.any()
    # The same surface counts where others at its depth have texture.
    seen = plane(20, 4, 96, 96)
    assert [part.counts.any() for part in parts_of([made, hidden, seen])] == [True, True, True]
