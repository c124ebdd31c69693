"""Get a data set by its name: its files, from a folder or its site, and then its store."""

import os
import re
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from dfdbench.building.build import BuildReport, build_store, refuse_another_set
from dfdbench.building.fetching import Progress, known_checksums
from dfdbench.building.new_manifest import with_found_scenes
from dfdbench.building.sources import Source, open_source
from dfdbench.building.sources.middlebury import Download, download_middlebury
from dfdbench.datasets.catalog import default_store, find_manifest, of_seed
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, Problem, refuse_both
from dfdbench.results.output_place import output_place
from dfdbench.system.cache import DOWNLOADS, cache_folder
from dfdbench.system.location import Place, as_location, is_local
from dfdbench.system.parallel import Pool, Shown


def obtain(
    manifest: Manifest,
    folder: Path | None = None,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    cache: Path | str | None = None,
    on_progress: Progress | None = None,
    steps: tuple[int, int] | None = None,
) -> tuple[Source, Download | None]:
    """Find the files of a data set; download them first if possible.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path, optional
        Where the files are; by default Middlebury's are downloaded into the cache.
    mirrors : sequence of str
        Addresses to ask before the site, and before those in DFDBENCH_MIRROR.
    offline : bool
        Use only what was downloaded before.
    cache : Path or str, optional
        The cache folder.
    on_progress : callable, optional
        Called with (files done, total files, bytes).
    steps : tuple of int, optional
        In-focus and defocus voltage step, in place of the manifest's.

    Returns
    -------
    Source
        The files.
    Download or None
        What was downloaded; None if nothing was.

    Raises
    ------
    InputError, SourceError
        If options contradict each other, or files cannot be obtained.
    """
    if folder is not None or manifest.reader != "middlebury":
        here = {manifest.short if folder is None else "--source": True}
        refuse_both(here, {"--mirror": mirrors, "--offline": offline})
        return open_source(manifest, folder, manifest.checksums, steps), None
    refuse_both({"--offline": offline}, {"--mirror": mirrors})
    mirrors = (*mirrors, *os.environ.get("DFDBENCH_MIRROR", "").split())
    InputError.raise_if(
        Problem(f"not an address, https://HOST/FOLDER: {one}", where="--mirror or DFDBENCH_MIRROR")
        for one in mirrors
        if not re.match(r"https?://[^/]+", one)
    )
    place = cache_folder(cache) / DOWNLOADS / manifest.file_stem
    done = download_middlebury(manifest, place, mirrors, offline, on_progress)
    if not done.new and not done.kept:
        what = f"no file of {manifest.short} is there" + ", and --offline asks nobody" * offline
        fix = "build once without --offline" if offline else "name a --mirror URL"
        fix += ", or name a copy on disk: --source DIR"
        raise InputError.of([Problem(what, where=str(place), fix=fix), *done.lacking])
    return open_source(manifest, place, known_checksums(manifest, place)), done


def build_dataset(
    name: str,
    source: Path | None = None,
    *,
    store: Place | None = None,
    recipe: str | None = None,
    steps: tuple[int, int] | None = None,
    mirrors: Sequence[str] = (),
    offline: bool = False,
    seed: int | str | None = None,
    pool: Pool | None = None,
    cache: Path | str | None = None,
    shown: Shown = lambda what: nullcontext(),
    on_fetched: Callable[[Download], None] = lambda done: None,
) -> BuildReport:
    """Find a data set's files, and build its store from them.

    Parameters
    ----------
    name, source, store, recipe, steps, mirrors, offline, seed, cache, shown
        As in `dfdbench.build`.
    pool : Pool, optional
        As in `build_store`.
    on_fetched : callable
        Called with what was downloaded, before the build starts.

    Raises
    ------
    DfdbenchError
        As in `refuse_another_set`, `obtain` and `build_store`; if the store would be written into
        something else.
    """
    found = find_manifest(of_seed(name, seed))
    place = as_location(store or default_store(found, cache))
    refuse_another_set(found, place, recipe, steps, cache)
    manifest = with_found_scenes(found, source)
    if is_local(place):
        # The cache may be inside the folder of the files, but a place that the user names may not.
        output_place(place.path, source if store else None, option="--store", replaces=True)
    with shown(f"fetching {manifest.short}") as step:
        files, done = obtain(manifest, source, mirrors, offline, cache, step, steps)
    if done:
        on_fetched(done)
    with shown(f"building {name}") as step:
        return build_store(manifest, files, place, recipe, pool, step)


def voltage_pair_sets(
    manifest: Manifest,
    pairs: Sequence[Any],
    source: Path | None,
    cache: Path | str | None = None,
    pool: Pool | None = None,
    shown: Shown = lambda what: nullcontext(),
    on_built: Callable[[BuildReport], None] = lambda report: None,
) -> dict[str, Dataset]:
    """Return the sets of pairs of voltage steps, building those that are missing.

    Parameters
    ----------
    manifest : Manifest
        The captured data set.
    pairs : sequence
        Pairs of voltage steps, such as ``135-141``.
    source : Path or None
        The folder of the captures; needed if a set is not built yet.
    cache : Path or str, optional
        The cache folder with the sets.
    pool, shown
        As in `build_dataset`.
    on_built : callable
        Called with the report of each build.

    Raises
    ------
    InputError
        If one is not such a pair; if a set is not built and no folder of captures is named.
    SourceError
        If the captures lack a pair's voltage steps altogether.
    """
    steps = {
        pair: steps_of(pair, "-", "--values", "as 141-129,140-130") for pair in map(str, pairs)
    }
    usual = default_store(manifest, cache)
    places = {pair: usual.with_name(f"{manifest.stem}-{pair}.zarr") for pair in steps}
    left = [pair for pair, place in places.items() if not place.exists()]
    if left and source is None:
        what = f"the sets of these voltage steps are not built: {', '.join(left)}"
        fix = "name the folder of the captures: --source DIR"
        raise InputError(what, where=str(usual.parent), fix=fix)
    # Report a step that does not exist before the first set is built.
    sources = {pair: open_source(manifest, source, pair=steps[pair]) for pair in left}
    for pair, files in sources.items():
        with shown(f"building {manifest.stem}, steps {pair}") as step:
            report = build_store(manifest, files, places[pair], None, pool, step)
        on_built(report)
    return {pair: Dataset(place) for pair, place in places.items()}


def steps_of(pair: str, between: str, where: str, expected: str) -> tuple[int, int]:
    """Return the two voltage steps in a text such as ``141-129``.

    Raises
    ------
    InputError
        If it does not name two.
    """
    parts = re.fullmatch(rf"\s*(\d+)\s*{between}\s*(\d+)\s*", pair)
    if not parts:
        what = "not a pair of voltage steps"
        raise InputError(what, where=where, expected=expected, got=pair)
    return int(parts[1]), int(parts[2])
