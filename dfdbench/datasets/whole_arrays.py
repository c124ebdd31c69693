"""A store's arrays, read so that a file that was lost is an error."""

from __future__ import annotations

import xarray
from upath import UPath
from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest
from zarr.abc.store import Store as ZarrStore
from zarr.storage import WrapperStore

from dfdbench.system.location import zarr_store


class WholeArrays(WrapperStore[ZarrStore]):
    """Zarr's view of a place where every chunk was written, so that none may be absent.

    Zarr itself reads an absent chunk as zeros: a lost file would become a black image.
    """

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return what lies under a key, None where there is no such group or array.

        Raises
        ------
        FileNotFoundError
            Where it is a chunk of an array, and is not there.
        """
        found = await super().get(key, prototype, byte_range)
        # As in Aloe/depth/c/0/0/0: scene, array, chunk.
        if found is None and key.split("/")[2:3] == ["c"]:
            raise FileNotFoundError(f"{key} is missing")
        return found


def open_scene(location: UPath, name: str) -> xarray.Dataset:
    """Return a scene of the store at a place, its arrays read as they are used.

    Raises
    ------
    Exception
        What zarr and xarray come to where files are damaged: see `dfdbench.datasets.damage`.
    """
    scene: xarray.Dataset = xarray.open_zarr(
        WholeArrays(zarr_store(location)),
        group=name,
        consolidated=False,
        chunks=None,
        zarr_format=3,
    )
    return scene
