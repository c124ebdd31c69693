"""One captured data set a pair of voltage steps, each beside the set of the manifest's own pair."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dfdbench.building.sources import Source, open_source
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_place import default_store
from dfdbench.errors import InputError


@dataclass(frozen=True)
class VoltagePairSets:
    """The sets of several pairs of voltage steps.

    Parameters
    ----------
    places : mapping of str to Path
        Where each pair's set lies or will lie, by the pair as ``135-141``.
    to_build : mapping of str to Source
        The captures of those that are not built yet.
    """

    places: Mapping[str, Path]
    to_build: Mapping[str, Source]


def voltage_pair_sets(
    manifest: Manifest, pairs: Sequence[Any], source: Path | None, cache: Path | None = None
) -> VoltagePairSets:
    """Return where the sets of pairs of voltage steps lie, and what is left to build.

    Parameters
    ----------
    manifest : Manifest
        The captured data set.
    pairs : sequence
        Pairs of voltage steps, as ``135-141``.
    source : Path or None
        The folder of the captures; needed where a set is not built yet.
    cache : Path, optional
        The cache folder, in which the sets lie.

    Raises
    ------
    InputError
        Where one is no such pair; where a set is not built and no folder of captures is named.
    SourceError
        Where the captures lack a pair's voltage steps altogether.
    """
    steps = {pair: _steps_of(pair) for pair in map(str, pairs)}
    usual = default_store(manifest, cache)
    places = {pair: usual.with_name(f"{manifest.stem}-{pair}.zarr") for pair in steps}
    left = [pair for pair, place in places.items() if not place.exists()]
    if left and source is None:
        what = f"the sets of these voltage steps are not built: {', '.join(left)}"
        raise InputError(
            what, where=str(usual.parent), fix="name the folder of the captures: --source DIR"
        )
    # A step that does not exist is told before the first set is built.
    return VoltagePairSets(
        places, {pair: open_source(manifest, source, pair=steps[pair]) for pair in left}
    )


def _steps_of(pair: str) -> tuple[int, int]:
    parts = re.fullmatch(r"(\d+)-(\d+)", pair)
    if not parts:
        raise InputError(
            "not a pair of voltage steps", where="--values", expected="as 141-129,140-130", got=pair
        )
    return int(parts[1]), int(parts[2])
