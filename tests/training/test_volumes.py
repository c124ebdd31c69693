from pathlib import Path

import numpy as np
import pytest
import torch

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.rendered import FIRST_TRAIN
from dfdbench.methods.volume_costs import levels_of
from dfdbench.training import volumes
from tests.methods.made_planes import slope


def captures(count: int) -> list[Capture]:
    found = []
    for seed in range(count):
        pair = slope(seed)
        images = np.stack([pair.infocus, pair.defocus])
        depth = pair.levels.astype(np.float32)
        depth[:5] = np.nan
        found.append(Capture(Pair(f"Slope{seed}", ()), images, depth))
    return found


def test_examples_tell_the_depth_and_know_the_others_prior() -> None:
    first, second = volumes.examples_of(captures(2))
    assert first.roots.shape == (volumes.COUNT, 48, 128)
    assert (first.levels[:5] == -1).all()
    cheapest = levels_of(volumes.COUNT)[first.roots.argmin(0)]
    truth = first.levels[::2, ::2]
    # Where blur is too little to be told, levels are confused.
    assert np.median(np.abs(cheapest - truth)[10:40, 8:100]) <= 8
    assert second.prior.max() == 0
    assert first.prior.shape == (volumes.COUNT,)


def test_cameras_that_only_test_see_rooms_that_no_other_sees() -> None:
    seen: dict[bool, set[int]] = {True: set(), False: set()}
    for kind, (cameras, count) in {"lens": volumes.LENSES, "stack": volumes.STACKS}.items():
        for number in range(cameras):
            tests = f"{kind}-{number:02}" in volumes.HELD_OUT
            seen[tests].update(volumes.rooms_of(kind, number, count))
    for number in range(volumes.MADE[0]):
        tests = f"law-{number:02}" in volumes.HELD_OUT
        assert len(set(volumes.sources_of(number))) == volumes.MADE[1]
        for lens, place in volumes.sources_of(number):
            seen[tests].add(volumes.rooms_of("lens", lens, volumes.LENSES[1])[place])
    assert not seen[True] & seen[False]
    # The board's test rooms of the public seed are none of them.
    assert min(seen[True] | seen[False]) == FIRST_TRAIN


@pytest.mark.slow
def test_rooms_are_made_once_and_are_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, count in (("LENSES", (1, 2)), ("STACKS", (1, 3)), ("MADE", (1, 2))):
        monkeypatch.setattr(volumes, name, count)
    done: list[int] = []
    made = volumes.room_examples(tmp_path, lambda camera, cameras: done.append(camera))
    assert done == [1, 2, 3]
    sizes = {name: len(part) for name, part in made.items()}
    assert sizes == {"lens-00": 2, "stack-00": 3, "law-00": 2}
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = volumes.room_examples(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == times
    (tmp_path / "law-00.npz").unlink()
    anew = volumes.room_examples(tmp_path)
    for other in (again, anew):
        for name, part in made.items():
            for one, two in zip(part, other[name], strict=True):
                assert np.array_equal(one.roots, two.roots)
                assert np.array_equal(one.levels, two.levels)


def example(seed: int) -> volumes.Example:
    """Return an example whose costs tell its depth."""
    random = np.random.default_rng(seed)
    levels = np.kron(random.integers(0, 256, (8, 10)), np.ones((8, 8))).astype(np.int16)
    away = np.abs(levels[::2, ::2] - levels_of(volumes.COUNT)[:, None, None]) / 8
    roots = np.minimum(away * 51, 255).astype(np.uint8)
    told, guide = np.full((32, 40), 60, np.uint8), random.normal(size=(64, 80)).astype(np.float16)
    known = np.where(random.random(levels.shape) < 0.1, -1, levels).astype(np.int16)
    return volumes.Example(roots, roots, told, guide, known, np.zeros(volumes.COUNT, np.float32))


def test_however_a_crop_is_turned_costs_and_levels_lie_over_each_other() -> None:
    volume, *_, levels = volumes.draw([example(0)], 0, 0)
    assert volume.shape == (volumes.CROPS, volumes.COUNT, 32, 32)
    assert not torch.equal(levels, volumes.draw([example(0)], 0, 1)[-1])
    cheapest = volumes.DEPTHS[volume.argmin(1)]
    truth = levels[:, ::2, ::2]
    known = truth >= 0
    assert ((cheapest - truth)[known].abs() <= 4.5).all()
