"""Manifests of rendered sets by seed: ``unseen-7`` is drawn on demand."""

import re
from functools import cache
from importlib import resources

from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest

#: Raised whenever a seed would give other images: stores of an earlier version are refused.
GENERATOR = 1
#: The nearest and farthest distance in a room, in metres.
NEAR, FAR = 0.6, 6.0
#: How many rooms there are to test and to train on. Seed 0, which is public, has more of the
#: latter.
TEST, TRAIN, PUBLIC_TRAIN = 24, 24, 200
#: The number of the first training room; test rooms are numbered from 0.
FIRST_TRAIN = 1000
#: Per family, the name of a seed's sets and what a capture of each is.
FAMILIES = {
    "unseen": "one photograph at f/8 and one with a wide aperture",
    "unseen-stack": "nine photographs, focused from 0.65 m to 5 m, and one at f/8",
}
PUBLIC = "This seed is public, for development."
_NAME = re.compile(rf"({'|'.join(sorted(FAMILIES, reverse=True))})(?:-(0|[1-9]\d{{0,17}})(?:-1)?)?")


def seeded(name: str) -> tuple[str, int] | None:
    """Return the family and seed in a rendered set's name, with or without its version.

    Return None for any other name.

    Examples
    --------
    >>> seeded("unseen-7"), seeded("unseen-7-1"), seeded("unseen-stack"), seeded("demo")
    (('unseen', 7), ('unseen', 7), ('unseen-stack', 0), None)
    """
    found = _NAME.fullmatch(name)
    return (found[1], int(found[2] or 0)) if found else None


def scene_number(name: str) -> int:
    """Return the number of the room that a scene shows.

    Examples
    --------
    >>> scene_number("test-01"), scene_number("train-01")
    (0, 1000)
    """
    split, _, number = name.partition("-")
    return int(number) - 1 + (FIRST_TRAIN if split == "train" else 0)


def unseen_text(family: str, seed: int, train: int | None = None, test: int = TEST) -> str:
    """Return the text of a rendered set's manifest.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    seed : int
        The seed from which rooms, camera and noise are drawn; 0 or more.
    train, test : int, optional
        How many rooms each split has; numbers that differ from the released set's need another
        name.

    Examples
    --------
    >>> unseen_text("unseen", 7).splitlines()[1]
    'name = "unseen-7"'
    """
    train = train or (PUBLIC_TRAIN if seed == 0 else TRAIN)
    names = {
        split: [f"{split}-{number:0{len(str(count))}}" for number in range(1, count + 1)]
        for split, count in (("train", train), ("test", test))
    }
    splits = "".join(
        f'[[splits]]\nname = "{split}"\npartition = "published"\npairs = {len(scenes)}\n'
        f"scenes = {scenes}\n\n".replace("'", '"')
        for split, scenes in names.items()
    )
    scenes = "".join(
        f'[[scenes]]\nname = "{scene}"\nsource = "dfdbench"\n'
        for part in names.values()
        for scene in part
    )
    pair_images = "pair_images = [0, 1] # f/8, and focused at 0.65 m\n" * (family != "unseen")
    template = resources.files("dfdbench.datasets").joinpath("rendered.toml").read_text("utf-8")
    return template.format(
        family=family,
        seed=seed,
        short=family if seed == 0 else f"{family}-{seed}",
        what=FAMILIES[family],
        generator=GENERATOR,
        public=PUBLIC * (not seed),
        count=train + test,
        pair_images=pair_images,
        near=NEAR,
        far=FAR,
        splits=splits,
        scenes=scenes,
    )


@cache
def unseen_manifest(family: str, seed: int) -> Manifest:
    """Return the manifest of a rendered set, parsed from `unseen_text`.

    Examples
    --------
    >>> unseen_manifest("unseen", 7).stem, len(unseen_manifest("unseen", 0).scenes)
    ('unseen-7-1', 224)
    """
    return parse_manifest(unseen_text(family, seed).encode(), f"{family}-{seed}-1.toml")
