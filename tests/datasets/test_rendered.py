import pytest

from dfdbench.datasets.catalog import find_manifest, of_seed
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.rendered import scene_number, unseen_manifest, unseen_text
from dfdbench.errors import InputError


def test_a_seed_names_its_set_and_its_rooms() -> None:
    seven, public = find_manifest("unseen-7"), find_manifest("unseen")
    assert (seven.short, seven.stem, seven.depth.kind) == ("unseen-7", "unseen-7-1", "metres")
    assert [split.pairs for split in seven.splits] == [24, 24]
    assert [split.pairs for split in public.splits] == [200, 24]
    assert find_manifest("unseen-0") is public
    assert seven.sha256 != unseen_manifest("unseen", 8).sha256
    numbers = [scene_number(name) for name in public.scene_names]
    assert len(set(numbers)) == len(numbers)


def test_a_set_of_ones_own_may_have_fewer_rooms() -> None:
    text = unseen_text("unseen", 7, 6, 12).replace('"unseen-7"', '"mine"')
    mine = parse_manifest(text.encode(), "mine-1.toml")
    assert [(split.name, split.pairs) for split in mine.splits] == [("train", 6), ("test", 12)]
    numbers = [scene_number(name) for name in mine.scene_names]
    assert sorted(numbers) == [*range(12), *range(1000, 1006)]


@pytest.mark.parametrize("seed", ["-1", "1.5", "x", "", "007", "9" * 19])
def test_what_is_no_seed_or_given_to_a_set_without_is_refused(seed: str) -> None:
    with pytest.raises(InputError, match="not a seed"):
        of_seed("unseen-stack", seed)
    for name, told in (("demo", "not drawn from a seed"), ("unseen-8", "the name has a seed")):
        with pytest.raises(InputError, match=told):
            of_seed(name, 3)
