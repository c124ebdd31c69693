"""A source of images that are given to it, for the tests of what reads sources."""

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.sources import SceneImages, Whole
from dfdbench.datasets.manifest import Manifest, Pair


class MadeSource(Whole):
    """The same images for every scene, or for the one that is named; captured with `defocus`."""

    def __init__(
        self,
        manifest: Manifest,
        infocus: NDArray[np.uint8],
        depth: NDArray[np.uint8],
        defocus: NDArray[np.uint8] | None = None,
        scene: str = "all",
    ) -> None:
        super().__init__(manifest)
        self.scene = scene
        self.captures_defocus = defocus is not None
        available = np.ones(infocus.shape[: len(manifest.axes)], bool)
        self.images = SceneImages.of_pairs(infocus, depth, depth > 0, available, defocus)

    def available_pairs(self) -> tuple[Pair, ...]:
        return self._manifest.pairs(self.scene)

    def signature(self, scene: str) -> str:
        return "0" * 64

    def read(self, scene: str) -> SceneImages:
        return self.images
