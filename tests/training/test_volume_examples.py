from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.rendered import FIRST_TRAIN
from dfdbench.methods.volume_net import levels_of
from dfdbench.training import volume_examples
from dfdbench.training.volume_examples import (
    COUNT,
    HELD_OUT,
    LENSES,
    MADE,
    STACKS,
    examples_of,
    room_examples,
    rooms_of,
    sources_of,
)
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
    first, second = examples_of(captures(2))
    assert first.roots.shape == (COUNT, 48, 128)
    assert (first.levels[:5] == -1).all()
    cheapest = levels_of(COUNT)[first.roots.argmin(0)]
    truth = first.levels[::2, ::2]
    # Where blur is too little to be told, levels are confused.
    off = np.abs(cheapest - truth)[10:40, 8:100]
    assert np.median(off) <= 8
    assert second.prior.max() == 0
    assert first.prior.shape == (COUNT,)


def test_cameras_that_only_test_see_rooms_that_no_other_sees() -> None:
    seen: dict[bool, set[int]] = {True: set(), False: set()}
    for kind, (cameras, count) in {"lens": LENSES, "stack": STACKS}.items():
        for number in range(cameras):
            seen[f"{kind}-{number:02}" in HELD_OUT].update(rooms_of(kind, number, count))
    for number in range(MADE[0]):
        tests = f"law-{number:02}" in HELD_OUT
        assert len(set(sources_of(number))) == MADE[1]
        for lens, place in sources_of(number):
            seen[tests].add(rooms_of("lens", lens, LENSES[1])[place])
    assert not seen[True] & seen[False]
    # The board's test rooms of the public seed are none of them.
    assert min(seen[True] | seen[False]) == FIRST_TRAIN


@pytest.mark.slow
def test_rooms_are_made_once_and_are_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, count in (("LENSES", (1, 2)), ("STACKS", (1, 3)), ("MADE", (1, 2))):
        monkeypatch.setattr(volume_examples, name, count)
    done: list[int] = []
    made = room_examples(tmp_path, lambda camera, cameras: done.append(camera))
    assert done == [1, 2, 3]
    assert {name: len(part) for name, part in made.items()} == {
        "lens-00": 2,
        "stack-00": 3,
        "law-00": 2,
    }
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = room_examples(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == times
    (tmp_path / "law-00.npz").unlink()
    anew = room_examples(tmp_path)
    for other in (again, anew):
        for name, part in made.items():
            for one, two in zip(part, other[name], strict=True):
                assert np.array_equal(one.roots, two.roots)
                assert np.array_equal(one.levels, two.levels)
