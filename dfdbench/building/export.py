"""Export a store's pairs as PNG files, and depth that they cannot hold as arrays."""

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.building.sources.middlebury import depth_name, image_name
from dfdbench.datasets.captured_files import BY_IMAGE
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import StoreError, reason_of
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import OnDone, one_by_one

#: The file with the facts about a stack's images.
STACK_FILE = "stack.json"
#: Its attribute for the two images that a method of pairs gets.
PAIR_IMAGES = "pair_images"
_STACK_DEPTH = "depth.npy"


def export_png(
    store: Dataset,
    folder: Path,
    split: str = "all",
    on_pair: OnDone | None = None,
    images_only: bool = False,
) -> int:
    """Write each pair's in-focus image, defocus image and depth map as files.

    The in-focus image is named after the pair, ``SCENE/exposure_ms10.png``, and the depth map after
    its own axes, ``SCENE/depth.png``, or ``.npy`` if it is in metres or has fractions. Pairs by
    view, illumination and exposure get Middlebury's names, ``SCENE/Illum1/Exp2/view1.png`` and
    ``SCENE/disp1.png``. The defocus image is beside the in-focus one. It is named after its recipe,
    ``view1_lin_0.32_2.88.png`` for ``published`` as in the thesis; if it was captured,
    ``exposure_ms10_defocus.png``; on a track, ``view1_camera-2.png``. Decoded, the files equal the
    store's arrays. Files that already have this content are kept.

    Parameters
    ----------
    store : Dataset
        The data set.
    folder : Path
        Where to write.
    split : str
        The pairs to write.
    on_pair : callable, optional
        Called with (pairs done, total pairs).
    images_only : bool
        Write no depth, and name the images ``PAIR/infocus.png`` and ``PAIR/defocus.png``. Then
        `dfdbench.evaluation.evaluate` takes depth maps named after those folders, ``PAIR.npy``.

    Notes
    -----
    A stack is written into a folder ``PAIR``: its images, ``stack.json`` with what is known of
    them, and, unless `images_only`, ``depth.npy``.

    Returns
    -------
    int
        How many pairs were written or already there.

    Raises
    ------
    StoreError
        If the store holds no pair of the split, a file of that name holds something else, the
        folder already has a pair's depth despite `images_only`, or the disk refuses to write.
    """
    # A track does not reveal its recipe.
    captured = store.manifest.degradation if store.manifest.on_track else "defocus"
    blurred = blur_name(store.recipe) if store.recipe else captured
    pairs = store.some_pairs(split)
    for pair in pairs if images_only else ():
        usual = Path(pair.scene, _names(store.manifest, pair)[1])
        places = (usual, usual.with_suffix(".npy"), Path(pair.id, _STACK_DEPTH))
        if there := next((place for place in places if (folder / place).exists()), None):
            what = "a depth map lies there, which methods must not see"
            raise StoreError(what, where=str(folder / there), fix="export into another folder")
    for pair in one_by_one(pairs, on_pair):
        images = store.read(pair)
        if not images.is_pair:
            _write_stack(folder / pair.id, images, images_only, store.manifest.pair_images)
        elif images_only:
            _write(folder / pair.id / "infocus.png", images.infocus)
            _write(folder / pair.id / "defocus.png", images.defocus)
        else:
            sharp, depth = (folder / pair.scene / name for name in _names(store.manifest, pair))
            _write(sharp, images.infocus)
            _write(sharp.with_name(f"{sharp.stem}_{blurred}.png"), images.defocus)
            if images.truth.dtype == np.uint8:
                _write(depth, images.levels)
            else:
                _write(depth.with_suffix(".npy"), images.depth)
    return len(pairs)


def _write_stack(
    folder: Path, capture: Capture, images_only: bool, pair_images: list[int] | None
) -> None:
    stack = capture.stack
    names = [f"image_{number:02}.png" for number in range(len(capture.images))]
    for name, image in zip(names, capture.images, strict=True):
        _write(folder / name, image)
    known = {key: stack[key].values.tolist() for key in ("role", *BY_IMAGE)}
    coordinates = {key: [_in_json(value) for value in values] for key, values in known.items()}
    attributes = {key: _in_json(value) for key, value in stack.attrs.items()}
    attributes |= {PAIR_IMAGES: pair_images} if pair_images else {}
    said = {"images": names, "coordinates": coordinates, "attributes": attributes}
    write_whole(folder / STACK_FILE, json.dumps(said, indent=1).encode() + b"\n")
    if not images_only:
        _write(folder / _STACK_DEPTH, capture.depth)


def _in_json(value: Any) -> Any:
    # JSON has neither NaN nor infinity.
    return {"nan": None, "inf": "inf"}.get(str(value), value)


def _names(manifest: Manifest, pair: Pair) -> tuple[str, str]:
    """Return the names of a pair's in-focus image and depth map below its scene's folder."""
    if "view" in pair.at and pair.at.keys() <= {"view", "illumination", "exposure"}:
        return image_name(pair.at), depth_name(pair.at)
    places = [f"{axis}{value}" for axis, value in pair.coordinates]
    depth = [f"_{axis}{pair.at[axis]}" for axis in manifest.depth.axes]
    return f"{'/'.join(places)}.png", f"depth{''.join(depth)}.png"


def blur_name(recipe: BlurRecipe) -> str:
    """Return the thesis's file-name suffix of a blur: linear, smallest sigma, step times levels.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES
    >>> blur_name(RECIPES["published"]), blur_name(RECIPES["text"])
    ('lin_0.32_2.88', 'lin_0.32_2.56')
    """
    return f"lin_{recipe.sigma_min:.2f}_{recipe.sigma_step * recipe.levels:.2f}"


def _write(path: Path, image: NDArray[Any]) -> None:
    stored = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    is_array, file = path.suffix == ".npy", io.BytesIO()
    if is_array:
        np.save(file, image)
    content = file.getvalue() if is_array else cv2.imencode(".png", stored)[1].tobytes()
    try:
        if path.exists():
            # Another encoder's PNG file may hold the same image.
            there = None if is_array else cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            alike = there is not None and np.array_equal(there, stored)
            if alike or path.read_bytes() == content:
                return
            fix = "export into another folder; pairs before this one are written"
            raise StoreError("a file of that name holds something else", where=str(path), fix=fix)
        write_whole(path, content)
    except OSError as error:
        raise StoreError("cannot write the image", where=str(path), got=reason_of(error)) from error
