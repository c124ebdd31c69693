"""What trains where a fold tests."""

from __future__ import annotations

from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import unknown_name


def training_of(manifest: Manifest, fold: str) -> tuple[str, ...]:
    """Return the scenes that train when a fold, or a single scene, tests: all others.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> len(training_of(find_manifest("middlebury"), "K03"))
    24
    """
    tested = set(manifest.scenes_of(fold))
    return tuple(scene for scene in manifest.scene_names if scene not in tested)


def require_fold(manifest: Manifest, fold: str) -> None:
    """Refuse what is neither a fold nor a single scene of a data set.

    Raises
    ------
    UnknownNameError
        Where it is neither.
    """
    known = (*(item.name for item in manifest.folds), *manifest.scene_names)
    if fold not in known:
        raise unknown_name(f"fold or scene of {manifest.stem}", fold, known)
