"""Estimate depth from your own photographs, without a data set."""

from __future__ import annotations

import contextlib
import functools
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.building.export import PAIR_IMAGES, STACK_FILE
from dfdbench.building.sources.captured_images import matched_as_learned
from dfdbench.building.sources.image_files import likely_bits
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.captures import Capture, capture_of
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import DfdbenchError, InputError, MethodError
from dfdbench.evaluation.fitting import camera_note, fit_again, require_run_of
from dfdbench.evaluation.lens import RIG, given_by_lens, is_lens, lens_law
from dfdbench.evaluation.loading import images_in
from dfdbench.evaluation.photographs import Image, read_images, read_stack, size_of
from dfdbench.evaluation.plan import identity_of
from dfdbench.methods.calling import call
from dfdbench.methods.fitted import Blur
from dfdbench.methods.method import DepthMap, Method, Predict
from dfdbench.methods.parameters import read_fields
from dfdbench.methods.process_state import one_at_a_time, seeded
from dfdbench.methods.registry import Facts, find_entry, load_method, registered_methods
from dfdbench.metrics.protocol import Unit
from dfdbench.optics.sharpness import laplacian_energy
from dfdbench.results.record import RESULT, Result, load_result
from dfdbench.results.run_folder import read_store_place
from dfdbench.system.files import read_text
from dfdbench.system.text import parse_json
from dfdbench.tables.table import counted

if TYPE_CHECKING:
    import xarray

# A larger share of pixels at one end of the levels is odd.
_MANY = 0.3
#: A run whose fit is used, or the blur: a lens, a recipe or a law, as fields or as a TOML file.
Camera = str | os.PathLike[str] | Mapping[str, Any] | Blur


@dataclass(frozen=True)
class Estimate:
    """A depth map estimated from photographs.

    Parameters
    ----------
    depth : ndarray of float32, shape (y, x)
        Depth levels, 0 (far) to 255 (near), or metres, on the in-focus image's pixels; NaN where
        the method has no answer.
    seconds : float
        How long the method took.
    found : str
        How the photographs were aligned, in words; empty if they were in register.
    sigma : ndarray of float32, shape (y, x), or None
        The standard deviation that the method gives each pixel, in the unit of the depth; None
        if it gives none.
    odd : tuple of str
        Anything that looks like a mistake, in words.
    """

    depth: DepthMap
    seconds: float
    found: str = ""
    sigma: DepthMap | None = None
    odd: tuple[str, ...] = ()


class DepthPredictor:
    """A method that is ready to estimate depth from photographs.

    Parameters
    ----------
    method : str, callable or Method, optional
        A registered name, ``module:attribute``, ``file.py:attribute``, the function or class
        itself, or what `load_method` returned, which may be fitted; by default the method of the
        run that `camera` names.
    camera : Run, Path, str, mapping, BlurRecipe or BlurLaw, optional
        What is known about the blur: a run or its folder, whose fit is used; or a lens, a blur
        recipe or a law, as fields or as a TOML file (`run` writes ``law.toml``).
    parameters : mapping
        The method's parameters.
    align : bool
        Align the photographs and match their brightness if they need it.
    seed : int
        For methods that draw random numbers.

    Raises
    ------
    MethodError
        If the method cannot be loaded, or needs the blur and is not given it.
    ResultError
        If the run's files are damaged.
    """

    def __init__(
        self,
        method: str | Callable[..., Any] | None = None,
        camera: Camera | None = None,
        parameters: Mapping[str, Any] | None = None,
        align: bool = True,
        seed: int = 0,
    ) -> None:
        self._align, self._seed = align, seed
        given = dict(parameters or {})
        fitted: Path | None = None
        self._scale: DepthScale | None = None
        self._levels_grow_with: Literal["nearness", "distance"] = "nearness"
        self._files: CapturedFiles | None = None
        self._pair_images: list[int] | None = None
        self._store: Dataset | None = None
        self._unknown = ""
        camera = Path(camera) if isinstance(camera, os.PathLike) else camera  # a run is one, too
        if isinstance(camera, str | Path) and (Path(camera) / RESULT).is_file():
            fitted = Path(camera)
            result = load_result(fitted / RESULT)
            if isinstance(method, str):
                require_run_of(method, find_entry(method), result.method, fitted)
            method = method or _own_method(result.method.name, fitted)
            given = {**result.method.parameters, **given}
            given = self._of_run(result, fitted, given)
        elif isinstance(camera, Path | str) and not Path(camera).exists() and method is None:
            raise InputError("no such run", where=str(camera), fix="name the folder of a run")
        elif camera is not None:
            if "recipe" in given:
                what = "the blur is named twice: as the camera, and as the parameter recipe"
                raise InputError(what, fix="leave out one of them")
            given["recipe"], self._scale = _blur(camera)
        if method is None:
            fix = "name a method (--method NAME), or a run of one (--fitted RUN)"
            raise MethodError("no method is named", fix=fix)
        images = images_in(given)
        self._fitted = fitted
        if isinstance(method, Method) and camera is None and not images[1]:
            # Its user may have fitted it, so it is not loaded again.
            self.method = replace(method, images=images[0] or method.images)
        else:
            found, self._takes_lens = _load(method, images[1], seed)
            self.method = replace(found, images=images[0])
            self._restore(fitted)
        self.unit: Unit = self.method.answers_in("levels")

    def _of_run(self, result: Result, folder: Path, given: dict[str, Any]) -> dict[str, Any]:
        """Take over what levels are and how pairs were matched; return the method's parameters."""
        name, known = result.dataset.name, list[Manifest]()
        # The store may be on another machine, and a user's own set has no manifest here.
        with contextlib.suppress(DfdbenchError):
            known.append(find_manifest(name))
        with contextlib.suppress(DfdbenchError):
            self._store = open_dataset(read_store_place(folder) or name)
            known.append(self._store.manifest)
        same = [each for each in known if each.sha256 == result.dataset.manifest_sha256]
        if same:
            self._scale, files = same[0].depth.scale, same[0].files
            self._levels_grow_with = same[0].depth.grows_with
            self._files = files if files and files.of_pairs else None
            self._pair_images = same[0].pair_images
        elif not result.dataset.recipe["name"]:
            self._unknown = name
        if "recipe" in result.method.uses:
            return {**given, "recipe": result.dataset.recipe["parameters"]}
        if given.get("recipe") == RIG and same:
            return given_by_lens(same[0], given)[0]
        if "recipe" in given:
            given["recipe"], scale = _blur(given["recipe"])
            self._scale = scale or self._scale
        return given

    @functools.cached_property
    def _matched_already(self) -> frozenset[bytes]:
        """The digests of the data set's own defocus images: its build has matched them."""
        if self._store is None or (self._store.manifest.files and not self._files):
            return frozenset()
        images = (capture.defocus.tobytes() for capture in self._store.captures())
        return frozenset(sha256(image).digest() for image in images)

    @property
    def identity(self) -> dict[str, Any]:
        """What must be the same to reuse the depth maps of an earlier call."""
        return {"align": self._align, **identity_of(self.method, self._seed, self._fitted)}

    def _restore(self, fitted: Path | None) -> None:
        if self.method.learner is None or (fitted and fit_again(self.method, fitted)):
            return
        what = "the run kept nothing that the method learned"
        if fitted is None:
            what = "the method learns the blur of a camera, and nothing says what it is"
            if self.method.parameters.get("sure"):
                what = "the method learns how sure it is, and nothing says from what"
        fix = "name a run on the same camera (--fitted RUN), with the same parameters"
        fix += ", or the lens (--lens FILE)" if self._takes_lens else ""
        raise MethodError(what, where=str(fitted or self.method.entry), fix=fix)

    @property
    def grows_with(self) -> Literal["nearness", "distance"]:
        """What its depth grows with, as in a manifest."""
        if self.unit == "metres":
            return "distance"
        if self._scale is None:
            return self._levels_grow_with
        return "distance" if self._scale.far_level > self._scale.near_level else "nearness"

    @property
    def meaning(self) -> str:
        """What the depth means, in words."""
        if self.unit == "metres":
            return "distances in metres"
        scale, turned = self._scale, self.grows_with == "distance"
        levels = f"depth levels from 0 ({'near' if turned else 'far'}) to 255 "
        levels += "(far)" if turned else "(near)"
        if scale is None:
            return f"{levels}; how far that is in metres is not known"
        law = "1 / distance" if scale.law == "inverse" else "distance"
        return (
            f"{levels}, evenly spaced in {law}: level {scale.far_level} is {scale.far:g} m, "
            f"level {scale.near_level} is {scale.near:g} m"
        )

    def metres(self, depth: DepthMap) -> DepthMap:
        """Convert one of its depth maps to metres.

        Raises
        ------
        MethodError
            If it holds levels, and nothing says what they are in metres.
        """
        if self.unit == "metres":
            return depth
        if self._scale is None:
            what = "the method answers in levels, and how far those are is not known"
            fix = "a method that answers in metres, or a run on a set with a scale (--fitted RUN)"
            raise MethodError(what, where=self.method.name, fix=f"take {fix}")
        return self._scale.to_metres(depth).astype(np.float32)

    def of_files(self, paths: Sequence[Path]) -> Estimate:
        """Estimate depth from two photographs or from a stack's folder, as `captures_in` finds it.

        Raises
        ------
        InputError, SourceError, MethodError
            If the files cannot be read, or there is no estimate.
        """
        if len(paths) == 1:
            return self.of_stack(read_stack(*paths))
        return self(*self.read(paths))

    def read(self, images: Iterable[Image | Path | str]) -> list[Image]:
        """Read images that are files, as the run's data set does; return arrays as they are.

        Raises
        ------
        SourceError
            If images cannot be read; it lists the problems of each.
        """
        return read_images(images, self._files)

    def settle_unit(self, captures: Iterable[Sequence[Path]]) -> None:
        """Find out which unit the depth of these files has, as `captures_in` returns them.

        Raises
        ------
        InputError
            If some depth maps would be in metres and others in levels.
        """
        kinds = set[Unit]()
        for paths in captures:
            # What cannot be read gets no depth map.
            with contextlib.suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
                text = "{}" if len(paths) == 2 else read_text(paths[0] / STACK_FILE)
                in_metres = parse_json(text).get("attributes", {}).get("unit") == "metres"
                kinds.add("metres" if in_metres else "levels")
        units = {self.method.answers_in(kind) for kind in kinds}
        if len(units) > 1:
            fix = "put each kind into a folder of its own"
            raise InputError("some depth maps would be in metres, others not", fix=fix)
        self.unit = units.pop() if units else self.unit

    def of_stack(self, stack: xarray.DataArray) -> Estimate:
        """Estimate depth from a registered focal stack in the form of `dfdbench.Capture.stack`.

        Raises
        ------
        InputError
            If it is not a stack, or the method takes pairs and it has no two images for one.
        MethodError
            If the method raises or returns no depth map.
        """
        whole = capture_of(stack)
        usual = None if whole.is_pair else self._pair_images or stack.attrs.get(PAIR_IMAGES)
        capture = whole.two_of(self.method.two_images(usual))
        self.unit = self.method.answers_in(capture.about.kind)
        estimate = self._answer(*self.method.called_on(capture))
        return replace(estimate, odd=_few_bits(capture.images))

    def _answer(self, predict: Predict, images: Sequence[Any], found: str = "") -> Estimate:
        with one_at_a_time(), seeded(self._seed):
            answer = call(predict, *images, unit=self.unit)
        if answer.depth is None:
            fix = f"mend the method; dfdbench check-method {self.method.entry} tries more images"
            ours = self.method.entry.startswith("dfdbench.")
            raise MethodError(f"no depth map: {answer.error}", fix="" if ours else fix)
        return Estimate(answer.depth, answer.seconds, found, answer.sigma)

    def __call__(self, infocus: Image, defocus: Image) -> Estimate:
        """Estimate depth from an in-focus and a defocus image, as for `predict`.

        Raises
        ------
        InputError
            If they are not photographs, differ in size, or cannot be aligned.
        MethodError
            If the method raises, returns no depth map, or needs a stack.
        """
        if self.method.attribute("needs_stack"):
            what = f"{self.method.name} needs a focal stack, and this is a pair"
            raise MethodError(what, fix="name a folder of stacks: STACK/stack.json and its images")
        infocus, defocus = _as_photograph(infocus), _as_photograph(defocus)
        swapped = laplacian_energy(defocus) > laplacian_energy(infocus)
        if infocus.dtype != defocus.dtype:
            got = f"{infocus.dtype} and {defocus.dtype}"
            raise InputError("the photographs have different types of pixels", got=got)
        if infocus.shape != defocus.shape:
            sizes = f"{size_of(infocus)} and {size_of(defocus)}"
            fix = "crop or resample them to the same size"
            raise InputError(f"the photographs differ in size: {sizes}", fix=fix)
        found = ""
        blurs = [one for one in self.method.attribute("blurs") or () if isinstance(one, Blur)]
        laws = [blur for blur in blurs if isinstance(blur, BlurLaw)]
        if self._align and self._unknown:
            what = "how the photographs of the run's data set were matched is not known here"
            fix = "build it again, or match these yourself and say --no-align"
            raise InputError(what, where=self._unknown, fix=fix)
        if self._align:
            digest = sha256(defocus.tobytes()).digest()
            # Blurring by a recipe says nothing of how photographs are to be matched.
            files = self._files
            files = files if files and (files.defocus or files.images) else None
            files = CapturedFiles() if digest in self._matched_already else files
            infocus, defocus, found = matched_as_learned(infocus, defocus, files, laws)
        unknown = np.full(infocus.shape[:2], np.nan, np.float32)
        pair = Capture(Pair("pair", ()), np.stack([infocus, defocus]), unknown)
        estimate = self._answer(*self.method.called_on(pair), found)
        odd = _oddities(estimate.depth, self.unit, swapped) + _few_bits(pair.images)
        if self._fitted and len(blurs) == 1 and (note := camera_note(blurs[0], [pair])):
            odd += (note,)
        return replace(estimate, odd=odd)


def _few_bits(images: NDArray[Any]) -> tuple[str, ...]:
    bits = likely_bits(int(images.max())) if images.dtype == np.uint16 else None
    what = f"the images of 16 bits hold {bits} at most, and are taken as very dark"
    return (what,) if bits else ()


def _oddities(depth: DepthMap, unit: Unit, swapped: bool) -> tuple[str, ...]:
    odd = []
    at_ends = max(np.mean(depth <= 0), np.mean(depth >= LAST_LEVEL))
    if unit == "levels" and at_ends > _MANY:
        share = f"{100 * at_ends:.0f} % of the pixels are at one end of the levels"
        what = "much of the scene is that near or far, the blur is not that of the photographs, "
        what += "or the blurred one is named first"
        odd.append(f"{share}: {what}")
    if swapped:
        odd.append("the second photograph is the sharper one: are the two swapped?")
    return tuple(odd)


def predict(
    method: str | Callable[..., Any] | None,
    images: tuple[Image | Path | str, Image | Path | str] | xarray.DataArray,
    camera: Camera | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    align: bool = True,
    seed: int = 0,
) -> DepthMap:
    """Estimate a depth map from two photographs of one scene, or from a focal stack.

    Parameters
    ----------
    method, camera, parameters, align, seed
        As for `DepthPredictor`.
    images : tuple or DataArray
        The in-focus and the defocus image: files, or arrays of uint8 or uint16, shape (y, x, 3),
        RGB, or (y, x), grey. Or a stack in register, dimensions (image, y, x, channel), with the
        coordinates that `Capture.stack` has.

    Returns
    -------
    ndarray of float32, shape (y, x)
        Depth levels, 0 (far) to 255 (near), or metres if the method answers in metres; NaN where
        it has no answer. `DepthPredictor` also returns how sure it is, as ``Estimate.sigma``.

    Raises
    ------
    InputError, SourceError
        If an image cannot be read, or the two do not match.
    MethodError
        If the method cannot be loaded, is not given the blur, or returns no depth map.

    Examples
    --------
    >>> image = np.random.default_rng(0).integers(0, 256, (40, 50, 3)).astype(np.uint8)
    >>> depth = predict("local", (image, image), "published", align=False)
    >>> depth.shape, float(depth.min())
    ((40, 50), 255.0)
    """
    import xarray

    predictor = DepthPredictor(method, camera, parameters, align, seed)
    if isinstance(images, xarray.DataArray):
        estimate = predictor.of_stack(images)
    elif not isinstance(images, tuple | list) or len(images) != 2:
        several = isinstance(images, tuple | list)
        got = counted(len(images), "image") if several else type(images).__name__
        expected = "(capture.infocus, capture.defocus), two files, or capture.stack"
        raise InputError("neither two photographs nor a stack", expected=expected, got=got)
    else:
        estimate = predictor(*predictor.read(images))
    for text in estimate.odd:
        warnings.warn(text, stacklevel=2)
    return estimate.depth


def _own_method(name: str, run: Path) -> str:
    """Return the method of a run, if its code is ours or installed: anyone may have written it."""
    ours = registered_methods()
    if name not in {*ours, *ours.values()}:
        what = f"the run is of {name!a}, and its code is run only if you name it"
        fix = f"read the code, then name it: --method {name!a}"
        raise MethodError(what, where=str(run), fix=fix)
    return name


def _load(
    method: str | Callable[..., Any], parameters: Mapping[str, Any], seed: int
) -> tuple[Method, bool]:
    """Return a method, and whether it takes a lens but was not given one."""
    asked = []

    def recipe() -> None:
        fix = "say what the lens is (--lens FILE), or give a recipe (--param recipe=published)"
        raise MethodError("the method needs to be given the blur", where=str(method), fix=fix)

    offers: Facts = {"recipe": recipe, "seed": lambda: seed, "rig": Rig}
    unknown: Facts = {"recipe": lambda: asked.append("recipe")}
    return load_method(method, parameters, offers, unknown), bool(asked)


def _blur(camera: Camera) -> tuple[Any, DepthScale | None]:
    """Return a method's `recipe`, and what levels are in metres if that is known."""
    fields, where = camera, "camera"
    if isinstance(camera, str | Path) and Path(camera).suffix == ".toml":
        fields, where = read_fields(camera), str(camera)
    if isinstance(fields, Mapping) and is_lens(fields):
        return lens_law(fields, where), DepthScale.model_validate(fields["scale"])
    return fields, None


def _as_photograph(image: Any) -> Image:
    """Return an array as it is, or grey as RGB; raise if it is not a photograph."""
    array = np.asarray(image)
    shape = array.shape[:2] if array.ndim == 2 else (*array.shape[:2], 3)
    if array.dtype not in (np.uint8, np.uint16) or array.shape != shape or not array.size:
        got = f"{array.dtype}, shape {array.shape}"
        expected = "uint8 or uint16, shape (y, x, 3), RGB, or (y, x), grey"
        raise InputError("an array that is no photograph", expected=expected, got=got)
    return array if array.ndim == 3 else np.repeat(array[..., np.newaxis], 3, axis=2)
