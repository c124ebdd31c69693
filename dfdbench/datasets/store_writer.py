"""Write a data set scene by scene beside its place, then move it there as a whole."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import xarray
import zarr
import zarr.storage
from upath import UPath
from zarr.abc.buffer import Buffer

from dfdbench.datasets.dataset import FORMAT, FORMAT_VERSION
from dfdbench.datasets.fingerprint import combine, open_scene, scene_digests, signed
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import DfdbenchError, Problem, StoreError, reason_of, room_or
from dfdbench.system import location
from dfdbench.system.files import hold
from dfdbench.tables.table import counted, listed

_METADATA = "zarr.json"


@dataclass(frozen=True)
class SceneWriter:
    """Write single scenes; several processes may do so at once.

    Parameters
    ----------
    path : UPath
        Where the finished store goes, and where an earlier one may be.
    partial : UPath
        Where it is written until then.
    attributes : mapping
        The store's attributes; finished scenes of a store with other attributes are not kept.
    """

    path: UPath
    partial: UPath
    attributes: Mapping[str, Any]

    def digest_of_finished(self, scene: str, signature: str) -> str | None:
        """Return a scene's digest if it was written completely from the same files, else None.

        The arrays are read back and hashed, so that a damaged scene is written again.
        """
        for place in (self.partial, self.path):
            digest = self._verified(place, scene, signature)
            if digest and place == self.path:
                with disk_errors(self.path):
                    location.copy_folder(place / scene, self.partial / scene, _METADATA)
            if digest:
                return digest
        return None

    def write(self, scene: str, dataset: xarray.Dataset, signature: str) -> str:
        """Write one scene and return its digest, whose presence marks the scene as finished."""
        digests = scene_digests(dataset)
        record = {"array_digests": digests, "source_sha256": signature, "digest": combine(digests)}
        # Build files in memory and write them at once: through zarr, each takes milliseconds.
        made: dict[str, Buffer] = {}
        dataset.assign_attrs(record).to_zarr(
            zarr.storage.MemoryStore(made),
            mode="w",
            zarr_format=3,
            consolidated=False,
            # An absent chunk must always mean a lost one: see `WholeArrays`.
            write_empty_chunks=True,
            encoding={
                str(name): {"chunks": _chunks(variable), "chunk_key_encoding": location.CHUNK_KEYS}
                for name, variable in dataset.variables.items()
            },
        )
        files = {name: content.to_bytes() for name, content in made.items()}
        with disk_errors(self.path):
            location.remove(self.partial / scene)
            location.write_folder(self.partial / scene, files, _METADATA)
        return combine(digests)

    def _verified(self, place: UPath, scene: str, signature: str) -> str | None:
        if not _says(place, self.attributes):
            return None
        try:
            dataset = open_scene(place, scene)
            if dataset.attrs.get("source_sha256") != signature:
                return None
            digest = combine(scene_digests(dataset))
        except Exception:
            # Damaged: written again.
            return None
        return digest if digest == dataset.attrs.get("digest") else None


class StoreWriter:
    """Build a store beside its place and move it there when it is done.

    Use it as a context manager. On disk it holds a lock, so that two builds cannot mix.

    Parameters
    ----------
    place : str, Path or UPath
        Where the finished store goes.
    manifest : Manifest
        The data set; the store keeps its text and hash.
    attributes : mapping
        The store's attributes; a partial store with other attributes is not continued.
    """

    def __init__(
        self, place: location.Place, manifest: Manifest, attributes: Mapping[str, Any]
    ) -> None:
        self.path = location.as_location(place)
        self.partial = self.path.with_name(self.path.name + ".partial")
        self._attributes = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "dfdbench_version": version("dfdbench"),
            "manifest_name": manifest.stem,
            "manifest_sha256": manifest.sha256,
            "manifest": manifest.toml,
            **attributes,
        }
        # A worker elsewhere has another working folder.
        here = location.is_local(self.path)
        whole, part = ((p.absolute() if here else p) for p in (self.path, self.partial))
        self.scenes = SceneWriter(whole, part, self._attributes)
        self._manifest, self._held = manifest, contextlib.ExitStack()

    def __enter__(self) -> Self:
        fix = "wait for it, or build elsewhere with --store PATH"
        taken = StoreError("another build is writing this store", where=str(self.path), fix=fix)
        with disk_errors(self.path), contextlib.ExitStack() as held:
            if location.is_local(self.path):
                self.path.parent.mkdir(parents=True, exist_ok=True)
                lock = Path(self.path.with_name(f".{self.path.name}.lock").path)
                held.enter_context(hold(lock, taken))
            self._refuse_what_is_not_ours()
            if not _says(self.partial, self._attributes):
                location.remove(self.partial)
            partial = zarr.open_group(location.zarr_store(self.partial), mode="a", zarr_format=3)
            partial.attrs.update(self._attributes)
            self._held = held.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        if exception[0] is not None and location.is_local(self.path) and not self.waiting:
            location.remove(self.partial)
        self._held.close()

    @property
    def waiting(self) -> tuple[str, ...]:
        """The scenes already written beside the place, for this build or one that continues it."""
        return location.folders_in(self.partial) if location.exists(self.partial) else ()

    def refuse_to_lose(self, missing: list[str], why: Iterable[Problem] = ()) -> None:
        """Refuse a build that lacks pairs of the store in place; `why` says why it lacks them.

        Raises
        ------
        StoreError
            If finishing would lose pairs.
        """
        found = _attributes_of(self.path)
        lost = set(missing) - set(found.get("missing_pairs", missing))
        if self._manifest.find_scenes and "missing_pairs" in found:
            # Scenes that are not found this time are missing from no list. A store whose manifest
            # cannot be read is replaced.
            with contextlib.suppress(DfdbenchError):
                before = parse_manifest(found["manifest"].encode(), str(self.path))
                gone = {p.id for p in before.pairs() if p.scene not in self._manifest.scene_names}
                lost |= gone - set(found["missing_pairs"])
        if lost:
            what = f"the store there holds {counted(len(lost), 'pair')} that this build lacks"
            fix = "build elsewhere with --store PATH, or delete that store; nothing was changed"
            problem = Problem(f"{what}: {listed(sorted(lost), 3)}", where=str(self.path), fix=fix)
            raise StoreError.of([*why, problem])

    def finish(self, digests: Mapping[str, str], missing: list[str]) -> str:
        """Move the store into its place as a whole; return its fingerprint."""
        fingerprint = combine(digests)
        if lost := set(digests) - set(self.waiting):
            what = f"the workers wrote {counted(len(lost), 'scene')} elsewhere"
            fix = "name a place that all workers share: --store PATH, or --cache"
            raise StoreError(what, where=str(self.partial), fix=fix)
        with disk_errors(self.path):
            for stray in set(location.folders_in(self.partial)) - set(digests):
                location.remove(self.partial / stray)
            said = {**self._attributes, "fingerprint": fingerprint, "missing_pairs": missing}
            store = zarr.open_group(location.zarr_store(self.partial), mode="r+", zarr_format=3)
            store.attrs.put(signed(said))
            location.move_folder(self.partial, self.path, _METADATA)
        return fingerprint

    def _refuse_what_is_not_ours(self) -> None:
        # Moving replaces whatever is there, and that must not be a folder of photographs.
        for place in (self.path, self.partial):
            if not location.exists(place):
                continue
            found = _attributes_of(place)
            ours = self._is_interrupted_move(place, found) or self._is_hardly_begun(place)
            if found.get("format") != FORMAT and not ours:
                what = "the place is taken by something that is no dfdbench store"
                fix = "choose another with --store PATH, or delete a store without zarr.json"
                raise StoreError(what, where=str(place), fix=fix)
        found = _attributes_of(self.path)
        for key, what in (("manifest_name", "data set"), ("recipe", "blur recipe")):
            if key in found and found[key] != self._attributes.get(key):
                other = f"{found[key]}, not {self._attributes.get(key)}"
                what = f"the store there holds another {what}: {other}"
                fix = "choose another place with --store PATH, or delete that store"
                raise StoreError(what, where=str(self.path), fix=fix)

    def _is_hardly_begun(self, place: UPath) -> bool:
        # A kill or a full disk can leave a folder without its attributes.
        if place != self.partial or not place.is_dir():
            return False
        return all(item.name.startswith(_METADATA) for item in place.iterdir())

    def _is_interrupted_move(self, place: UPath, found: Mapping[str, Any]) -> bool:
        # In an object store the new metadata is written last; until then the partial copy is whole.
        if place != self.path or location.is_local(place) or found:
            return False
        return "fingerprint" in _attributes_of(self.partial)


@contextlib.contextmanager
def disk_errors(place: UPath) -> Iterator[None]:
    """Turn errors of writing to a place into ones that the user can fix."""
    try:
        yield
    except DfdbenchError:
        raise
    except Exception as error:
        # Object store libraries raise their own errors: unreachable, forbidden, no bucket.
        if location.is_local(place) and not isinstance(error, OSError):
            raise
        fix = room_or("choose another place with --store PATH, or --cache DIR", error)
        fix += "; the same command goes on where it stopped"
        what = "cannot write the store"
        raise StoreError(what, where=str(place), got=reason_of(error), fix=fix) from error


def _chunks(variable: xarray.Variable) -> tuple[int, ...]:
    whole = {"y", "x", "channel"} & set(map(str, variable.dims))
    if not whole:
        return variable.shape
    return tuple(
        variable.sizes[dimension] if dimension in whole else 1 for dimension in variable.dims
    )


def _attributes_of(place: UPath) -> dict[str, Any]:
    try:
        return dict(zarr.open_group(location.zarr_store(place), mode="r", zarr_format=3).attrs)
    except Exception:
        return {}


def _says(place: UPath, attributes: Mapping[str, Any]) -> bool:
    found = _attributes_of(place)
    return {key: found.get(key) for key in attributes} == attributes
