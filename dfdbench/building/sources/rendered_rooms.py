"""Rendered rooms: the sets that are drawn from a seed."""

import hashlib

import numpy as np

from dfdbench.building.sources import SceneImages, Whole
from dfdbench.datasets.captures import PAIR, ImageFacts
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.rendered import GENERATOR, scene_number, seeded
from dfdbench.errors import SourceError


class Rooms(Whole):
    """The rooms of a seed, photographed by the seed's camera.

    Parameters
    ----------
    manifest : Manifest
        A rendered set's manifest; its name gives the family and the seed.
    """

    captures_defocus = True

    def __init__(self, manifest: Manifest) -> None:
        super().__init__(manifest)
        found = seeded(manifest.name)
        if found is None:
            what = "rooms are drawn from a seed, and the manifest's name has none"
            fix = "dfdbench build unseen --seed N, without a manifest"
            raise SourceError(what, where=manifest.stem, fix=fix)
        self._family, self._seed = found

    def signature(self, scene: str) -> str:
        """Return the SHA-256 of the seed, the room and the generator's version."""
        made_of = (self._family, self._seed, scene, GENERATOR)
        return hashlib.sha256(repr(made_of).encode()).hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Render one scene."""
        from dfdbench.simulation.unseen import render_pair, render_stack  # they compile

        render = render_pair if self._family == "unseen" else render_stack
        images, focus, depth, about = render(self._seed, scene_number(scene))
        distance = np.array([np.nan, *focus])
        facts = ImageFacts(
            PAIR[:1] + PAIR[1:] * len(focus),
            focus_distance=distance,
            focus_depth=distance,
            f_number=np.array([about["infocus_f_number"], *[about["f_number"]] * len(focus)]),
            focal_length=np.array(about["focal_length"]),
            pixel_pitch=np.array(about["pixel_pitch"]),
        )
        return SceneImages(images[np.newaxis], depth, np.ones(1, bool), facts, about)
