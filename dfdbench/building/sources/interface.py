"""What every source of images and depth maps gives, whatever it reads."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import PAIR, ImageFacts
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import Problem, SourceError


@contextmanager
def gathered(problems: list[Problem]) -> Iterator[None]:
    """Add what a SourceError in the block carries to a list, and go on."""
    try:
        yield
    except SourceError as error:
        problems.extend(error.problems)


class SceneError(SourceError):
    """A scene that cannot be made of its files, reported once the others are built."""


@dataclass(frozen=True)
class SceneImages:
    """What a source gives for one scene.

    Parameters
    ----------
    images : ndarray of uint8 or uint16, shape (*pair axes, image, y, x, channel)
        RGB; zero where a capture is not available. In-focus images alone where the build makes the
        others by a recipe.
    depth : ndarray of float32, shape (*depth axes, y, x)
        In the manifest's unit, NaN where it is not known.
    available : ndarray of bool, shape (*pair axes,)
        True where the capture is there.
    facts : ImageFacts, optional
        What is known of each image, shapes (image,) or (*pair axes, image).
    found : mapping, optional
        What the source found out about the scene, fit for JSON: the store keeps it.
    warnings : tuple of str, optional
        What looks odd and was built all the same.
    """

    images: NDArray[Any]
    depth: NDArray[np.float32]
    available: NDArray[np.bool_]
    facts: ImageFacts = field(default_factory=ImageFacts)
    found: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the depth is known, shape as `depth`."""
        return np.isfinite(self.depth)

    @property
    def infocus(self) -> NDArray[Any]:
        """The in-focus images, shape (*pair axes, y, x, channel)."""
        return np.asarray(self.images[..., self.facts.roles.index("infocus"), :, :, :])

    @property
    def defocus(self) -> NDArray[Any]:
        """The first defocus images, shape (*pair axes, y, x, channel)."""
        return np.asarray(self.images[..., self.facts.roles.index("defocus"), :, :, :])

    @classmethod
    def of_pairs(
        cls,
        infocus: NDArray[np.uint8],
        levels: NDArray[np.uint8],
        valid: NDArray[np.bool_],
        available: NDArray[np.bool_],
        defocus: NDArray[np.uint8] | None = None,
    ) -> Self:
        """Return what pairs consist of, shapes (*pair axes, y, x, channel), in depth levels.

        Without `defocus` the build makes it.
        """
        images = [infocus] if defocus is None else [infocus, defocus]
        depth = np.where(valid, levels, np.nan).astype(np.float32)
        facts = ImageFacts(PAIR[: len(images)])
        return cls(np.stack(images, axis=-4), depth, available, facts)


class Made:
    """What the sources of sets that the package makes itself have in common."""

    options: Mapping[str, Any] = {}

    def __init__(self, manifest: Manifest) -> None:
        self._manifest = manifest

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return every pair: nothing has to be fetched."""
        return self._manifest.pairs()

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return an empty text: nothing can be missing."""
        return ""


class Source(Protocol):
    """A data set's files, or its generator."""

    @property
    def options(self) -> Mapping[str, Any]:
        """What was asked for and changes the arrays; the store records it."""

    @property
    def captures_defocus(self) -> bool:
        """Whether `read` gives defocus images; where not, the build makes them by a recipe."""

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose image and depth map are there, in the manifest's order."""

    def signature(self, scene: str) -> str:
        """Return a SHA-256 that changes when what the scene is made from changes.

        Raises
        ------
        SceneError, SourceError
            As `read`.
        """

    def read(self, scene: str) -> SceneImages:
        """Read one scene.

        Raises
        ------
        SceneError
            With everything that is wrong with the scene's files, where the other scenes may be
            built without it.
        SourceError
            The same, where nothing may be built.
        """

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return what to do to get the pairs that are missing."""
