"""What every source of images and depth maps gives, whatever it reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import Pair
from dfdbench.errors import SourceError


class SceneError(SourceError):
    """A scene that cannot be made of its files, told when the others are built."""


@dataclass(frozen=True)
class SceneImages:
    """What a source gives for one scene.

    Parameters
    ----------
    infocus : ndarray of uint8, shape (*pair axes, y, x, channel)
        RGB; zero where a pair is not available.
    depth : ndarray of uint8, shape (*depth axes, y, x)
        Depth levels.
    valid : ndarray of bool, shape as `depth`
        True where the depth is known.
    available : ndarray of bool, shape (*pair axes,)
        True where the pair's image is there.
    defocus : ndarray of uint8, shape as `infocus`, optional
        RGB, where the source captured it; None where it is made from the in-focus image.
    found : mapping, optional
        What the source found out about the scene, fit for JSON: the store keeps it.
    warnings : tuple of str, optional
        What looks odd and was built all the same.
    """

    infocus: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    valid: NDArray[np.bool_]
    available: NDArray[np.bool_]
    defocus: NDArray[np.uint8] | None = None
    found: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


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
