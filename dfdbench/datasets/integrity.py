"""Recompute a store's fingerprint and name the arrays that are not what was built."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import combine, variable_digest
from dfdbench.errors import Problem, StoreError
from dfdbench.system.parallel import Pool, Threads


@dataclass(frozen=True)
class StoreDifference:
    """Something in a store that is not as it was built.

    Parameters
    ----------
    scene, array : str
        Where; `array` is empty where it concerns the whole scene.
    what : str
        What is wrong with it.
    """

    scene: str
    array: str
    what: str

    @property
    def place(self) -> str:
        """The scene, and the array if it is about one."""
        return f"{self.scene}/{self.array}".rstrip("/")


@dataclass(frozen=True)
class StoreVerification:
    """What a store holds against what it says it holds.

    Parameters
    ----------
    recorded, recomputed : str
        The fingerprint in its attributes, and that of its arrays; the latter is empty where an
        array cannot be read.
    scenes, arrays : int
        How many were looked at.
    differences : tuple of StoreDifference
        All that was found.
    """

    recorded: str
    recomputed: str
    scenes: int
    arrays: int
    differences: tuple[StoreDifference, ...]

    @property
    def sound(self) -> bool:
        """Whether the store holds what was built."""
        return not self.differences and self.recorded == self.recomputed


def verify_store(
    store: Dataset, pool: Pool | None = None, on_scene: Callable[[int, int], None] | None = None
) -> StoreVerification:
    """Recompute the fingerprint of a store from its arrays.

    Parameters
    ----------
    store : Dataset
        What to look at.
    pool : Pool, optional
        Where scenes are read, and how many at once.
    on_scene : callable, optional
        Called with (scenes done, scenes in all).
    """
    looked_at = (pool or Threads()).map(partial(_verified, store), store.scenes, on_done=on_scene)
    missing = [
        StoreDifference(scene, "", "the scene is missing")
        for scene in _scenes_expected(store)
        if scene not in store.scenes
    ]
    differences = [difference for scene in looked_at for difference in scene.differences]
    digests = {scene.name: scene.digest for scene in looked_at}
    return StoreVerification(
        store.fingerprint,
        combine(digests) if all(digests.values()) else "",
        len(looked_at),
        sum(scene.arrays for scene in looked_at),
        tuple(missing + differences),
    )


def require_sound(store: Dataset) -> None:
    """Refuse a store that does not hold what was built.

    Raises
    ------
    StoreError
        With everything that differs.
    """
    found = verify_store(store)
    items = found.differences
    if not found.sound and not items:
        items = (StoreDifference("fingerprint", "", f"{found.recomputed}, not the recorded one"),)
    what, fix = "the store does not hold what was built", "the dfdbench build that made it mends it"
    StoreError.raise_if(
        Problem(what, where=f"{store.path}, {item.place}", got=item.what, fix=fix) for item in items
    )


@dataclass(frozen=True)
class _Scene:
    name: str
    digest: str
    arrays: int
    differences: tuple[StoreDifference, ...]


def _verified(store: Dataset, scene: str) -> _Scene:
    try:
        dataset = store.stored(scene)
    except StoreError as error:
        why = f"cannot be opened: {error.problems[0].got}"
        return _Scene(scene, "", 0, (StoreDifference(scene, "", why),))
    digests = dataset.attrs.get("array_digests")
    recorded: dict[str, Any] = digests if isinstance(digests, dict) else {}
    found: dict[str, str] = {}
    differences = []
    for name in sorted(map(str, dataset.variables)):
        if name not in recorded:
            differences.append(StoreDifference(scene, name, "was not there when it was built"))
        try:
            found[name] = variable_digest(dataset[name])
        except Exception as error:
            if name in recorded:
                differences.append(StoreDifference(scene, name, f"cannot be decoded: {error}"))
            continue
        if name in recorded and found[name] != recorded[name]:
            differences.append(StoreDifference(scene, name, "holds other values"))
    unread = {difference.array for difference in differences}
    differences += [
        StoreDifference(scene, name, "is missing")
        for name in sorted(set(recorded) - set(found) - unread)
    ]
    if found == recorded and combine(found) != dataset.attrs.get("digest"):
        differences.append(StoreDifference(scene, "", "its recorded digests contradict each other"))
    whole = len(found) == len(dataset.variables)
    return _Scene(scene, combine(found) if whole else "", len(found), tuple(differences))


def _scenes_expected(store: Dataset) -> tuple[str, ...]:
    missing = set(store.attributes.get("missing_pairs", ()))
    there = {pair.scene for pair in store.manifest.pairs() if pair.id not in missing}
    return tuple(scene for scene in store.manifest.scene_names if scene in there)
