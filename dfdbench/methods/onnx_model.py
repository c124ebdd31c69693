"""A network in an ONNX file, described by a TOML file beside it; needs the extra ``onnx``."""

import hashlib
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, ValidationError, model_validator

from dfdbench.errors import MethodError, Problem, reason_of
from dfdbench.methods.method import Image
from dfdbench.system.files import read_as, read_text
from dfdbench.system.strict import Positive, StrictRecord, problems_of
from dfdbench.system.text import parse_toml
from dfdbench.tables.table import listed

if TYPE_CHECKING:
    import xarray

_LARGEST = 2**31  # bytes; protobuf holds no more
_NUMBERS: dict[str, type[np.generic]] = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
}
# How protobuf writes that weights are in another file, which results would not record: in field 13
# of a tensor, as a text. A model's own notes, in other fields, may have a location too; and a value
# of a graph, in its field 13, may be called so: then a type follows, whose first byte is a newline.
_LENGTH = rb"(?:[\0-\x7f]|[\x80-\xff][\x01-\x7f])"
_ELSEWHERE = re.compile(rb"\x6a%b\n\x08location\x12%b[^\n]" % (_LENGTH, _LENGTH))
# Where in onnxruntime's sources something failed; what failed comes after it.
_IN_SOURCES = re.compile(r"/onnxruntime_src/.*?\) ")
_PARTS = re.compile(r"\([A-Z]+\)|[A-Z]")

_INPUTS = "name the inputs infocus and defocus, or stack"

Name = Annotated[str, Field(min_length=1)]


class Description(StrictRecord):
    """What an ONNX model takes and gives: the TOML file beside it, MODEL.toml.

    `infocus` and `defocus`, or `stack`, name its inputs; `focus_distance` names the one for a
    stack's focus distances in metres. A stack holds the defocus images by focus distance or, if
    `roles` is ``all``, every image in the capture's order. `layout` has one letter per axis: N of
    size 1, S the images of a stack, C, H, W; axes in brackets are merged, as in N(SC)HW; by default
    it is NCHW, of a stack SCHW. Pixels, with channels in the order of `colour`, are scaled to 0 to
    `largest`, then `mean` is subtracted and the rest divided by `std`. Images are padded by
    reflection, at the bottom and on the right, to multiples of `multiple`.

    The outputs `depth` and, if there is one, `sigma` hold one number per pixel, rows and columns in
    the order of `layout`. Depth in `unit` is ``scale * output + offset`` or, with `inverse`, one
    over that. With `clip`, levels are clipped to 0 and 255.
    """

    infocus: Name | None = None
    defocus: Name | None = None
    stack: Name | None = None
    focus_distance: Name | None = None
    roles: Literal["defocus", "all"] = "defocus"
    layout: str = "NCHW"
    colour: Literal["rgb", "bgr", "grey"] = "rgb"
    largest: Literal[1, 255] = 255
    mean: list[FiniteFloat] = Field([0.0], min_length=1, max_length=3)
    std: list[Positive] = Field([1.0], min_length=1, max_length=3)
    multiple: Annotated[int, Field(ge=1, le=4096)] = 1
    depth: Name
    sigma: Name | None = None
    unit: Literal["levels", "metres"] = "levels"
    scale: FiniteFloat = 1.0
    offset: FiniteFloat = 0.0
    inverse: bool = False
    clip: bool = False
    trained_on: str = ""
    paper: str = ""

    @model_validator(mode="before")
    @classmethod
    def _with_layout(cls, given: Any) -> Any:
        of_stack = isinstance(given, dict) and given.get("stack")
        return {"layout": "SCHW"} | given if of_stack else given

    @property
    def channels(self) -> int:
        """The number of channels of an image."""
        return 1 if self.colour == "grey" else 3

    @property
    def inputs(self) -> list[str]:
        """The inputs that take images."""
        return [name for name in (self.infocus, self.defocus, self.stack) if name]

    def contradictions(self, file: Path) -> Iterator[Problem]:
        """Yield problems that involve more than one field."""
        stack = bool(self.stack)
        if len({*self.inputs}) != (1 if stack else 2):
            what = "the inputs are neither a pair nor a stack"
            yield Problem(what, where=str(file), fix=_INPUTS)
        if self.focus_distance and not stack:
            where = f"{file}: focus_distance"
            yield Problem("only a stack has focus distances", where=where, fix="leave it out")
        letters = re.sub("[()]", "", self.layout)
        wanted = set("HW") | set("C" * (self.channels > 1)) | set("S" * stack)
        whole = "".join(_PARTS.findall(self.layout)) == self.layout
        once = len(set(letters)) == len(letters)
        if not (whole and once and wanted <= set(letters) <= wanted | set("NC")):
            expected = f"{listed(sorted(wanted))} once each, as {'SCHW' if stack else 'NCHW'}"
            where = f"{file}: layout"
            yield Problem("not a layout", where=where, expected=expected, got=self.layout)
        for name, numbers in (("mean", self.mean), ("std", self.std)):
            if len(numbers) not in (1, self.channels):
                what, where = "not one number a channel", f"{file}: {name}"
                yield Problem(what, where=where, expected=f"1 or {self.channels} numbers")
        if not self.scale:
            yield Problem("all depth would be the same", where=f"{file}: scale", got="0")


def read_model(path: Path) -> "OnnxMethod | OnnxStackMethod":
    """Read an ONNX file and its description as a method of pairs or of stacks.

    Raises
    ------
    MethodError
        If a file is missing, damaged or uses unknown operators, a field is wrong, or the model
        lacks an input or output. It lists every problem.
    """
    content = read_as(MethodError, path, "the model", _LARGEST)
    about = _read_description(path.with_suffix(".toml"))
    if _ELSEWHERE.search(content):
        fix = "save it whole: onnx.save(onnx.load('MODEL.onnx'), 'WHOLE.onnx')"
        raise MethodError("the model keeps weights in another file", where=str(path), fix=fix)
    options = onnxruntime.SessionOptions()
    # With several threads, the rounding of sums would depend on their number.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # a dozen kinds, with no other base class in common
        got = _IN_SOURCES.sub("", str(error).partition("\n")[0])[:300]
        fix = "copy it again, export it with standard operators, or update onnxruntime"
        what = "onnxruntime cannot load the model"
        raise MethodError(what, where=str(path), got=got, fix=fix) from error
    MethodError.raise_if(_misfits(session, about, path))
    kind = OnnxStackMethod if about.stack else OnnxMethod
    return kind(session, about, hashlib.sha256(content).hexdigest())


def _read_description(file: Path) -> Description:
    try:
        said = parse_toml(read_text(file))
        about = Description.model_validate(said)
    except ValidationError as error:
        problems = problems_of(error, "wrong value", file=file)
        if not said.keys() & {"infocus", "defocus", "stack"}:
            problems.insert(0, Problem("no input is named", where=str(file), fix=_INPUTS))
        raise MethodError.of(problems) from error
    except FileNotFoundError as error:
        fix = "write it: docs/methods.md shows how; dfdbench export-onnx writes one of ours"
        raise MethodError("the model has no description", where=str(file), fix=fix) from error
    except (OSError, ValueError) as error:
        what = f"cannot read the model's description: {reason_of(error)}"
        raise MethodError(what, where=str(file)) from error
    MethodError.raise_if(about.contradictions(file))
    return about


def _misfits(session: Any, about: Description, path: Path) -> Iterator[Problem]:
    """Yield a problem for each mismatch between a description and a model."""
    inputs = {node.name: node for node in session.get_inputs()}
    outputs = [node.name for node in session.get_outputs()]
    file = path.with_suffix(".toml")
    named = [*about.inputs, *filter(None, [about.focus_distance])]
    for kind, used, there in (
        ("input", named, list(inputs)),
        ("output", [about.depth, *filter(None, [about.sigma])], outputs),
    ):
        for name in used:
            if name not in there:
                what, expected = f"the model has no such {kind}", listed(there) or "none"
                yield Problem(what, where=str(file), expected=expected, got=name)
    for name in (name for name in inputs if name not in named):
        fix = f"name it in {file.name}, or export a model without it"
        yield Problem(f"the model takes an input besides: {name}", where=str(path), fix=fix)
    parts = _PARTS.findall(about.layout)
    for node in (inputs[name] for name in named if name in inputs):
        shape = f"{node.type} of shape {node.shape}"
        if node.type not in _NUMBERS:
            expected = ", ".join(_NUMBERS)
            yield Problem(f"cannot give {node.name}", where=str(path), expected=expected, got=shape)
        elif node.name in about.inputs and not _takes(node.shape, parts, about.channels):
            expected = f"{about.layout} with {about.channels} channels, as {file.name} says"
            what, fix = f"{node.name} has another shape", f"correct layout or colour in {file.name}"
            yield Problem(what, where=str(path), expected=expected, got=shape, fix=fix)
        plain = about.largest == 255 and not any(about.mean) and {*about.std} == {1}
        if node.type == "tensor(uint8)" and node.name in about.inputs and not plain:
            fix = f"leave largest, mean and std out of {file.name}, or export it with floats"
            yield Problem(f"{node.name} takes whole levels, 0 to 255", where=str(path), fix=fix)


def _takes(shape: list[int | str | None], parts: list[str], channels: int) -> bool:
    sizes = {"N": 1, "C": channels}
    # If an image is 3 pixels high or wide, the layout is wrong: those are its channels.
    return len(shape) == len(parts) and all(
        not isinstance(size, int)
        or (size == sizes.get(part, size) and (part not in "HW" or size > 3))
        for size, part in zip(shape, parts, strict=True)
    )


class _Network:
    def __init__(self, session: Any, about: Description, weights_sha256: str) -> None:
        self._session, self._about = session, about
        self._inputs = {node.name: node for node in session.get_inputs()}
        self.weights_sha256 = weights_sha256
        self.unit, self.trained_on, self.paper = about.unit, about.trained_on, about.paper
        self.needs_stack = bool(about.focus_distance)

    def _depth(self, given: dict[str, NDArray[Any]], size: tuple[int, ...]) -> Any:
        about = self._about
        names = [about.depth, *filter(None, [about.sigma])]
        padded = tuple(length + -length % about.multiple for length in size)
        maps = [
            self._one_a_pixel(values, name, padded)[: size[0], : size[1]]
            for name, values in zip(names, self._session.run(names, given), strict=True)
        ]
        depth = about.scale * maps[0] + about.offset
        change = np.full_like(depth, abs(about.scale))
        if about.inverse:
            with np.errstate(divide="ignore"):
                depth = 1 / depth
            change *= depth**2  # the derivative of 1 / x
        if about.clip and about.unit == "levels":
            depth = np.clip(depth, 0, 255)
        return (depth, maps[1] * change) if about.sigma else depth

    def _one_a_pixel(self, values: Any, name: str, size: tuple[int, ...]) -> NDArray[np.float64]:
        array, layout = np.asarray(values), self._about.layout
        turned = layout.index("W") < layout.index("H")
        sides = size[::-1] if turned else size
        # All pixels may be in one axis; in two, those of another order would be scrambled.
        long = [length for length in array.shape if length > 1]
        if array.size != math.prod(size) or (len(long) > 1 and long != [*sides]):
            expected = f"one number for each of {size[0]} x {size[1]} pixels, in the order {layout}"
            raise MethodError(f"wrong output {name}", expected=expected, got=f"shape {array.shape}")
        found = array.reshape(sides).astype(np.float64)
        return found.T if turned else found

    def _arranged(self, name: str, images: Image) -> NDArray[Any]:
        """Return images, shape (image, y, x, 3), in the form that the named input takes."""
        about, node = self._about, self._inputs[name]
        if about.colour == "grey":
            grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in images]
            images = np.asarray(np.stack(grey)[..., np.newaxis], images.dtype)
        elif about.colour == "bgr":
            images = images[..., ::-1]
        below, right = (-length % about.multiple for length in images.shape[1:3])
        padded = np.pad(images, ((0, 0), (0, below), (0, right), (0, 0)), mode="reflect")
        most = np.iinfo(images.dtype).max  # photographs of 8 or of 16 bits
        scaled = padded.astype(np.float32) * np.float32(about.largest / most)
        normal = (scaled - np.array(about.mean, "f4")) / np.array(about.std, "f4")
        sizes = dict(zip("SHWC", normal.shape, strict=True)) | {"N": 1}
        letters = [letter for letter in about.layout if letter in "SHWC"]
        # An axis that the layout leaves out has size 1 and goes first.
        order = [letter for letter in "SHWC" if letter not in letters] + letters
        shape = [math.prod(sizes[c] for c in p.strip("()")) for p in _PARTS.findall(about.layout)]
        arranged = normal.transpose(["SHWC".index(letter) for letter in order]).reshape(shape)
        if any(isinstance(n, int) and n != s for n, s in zip(node.shape, shape, strict=True)):
            what, fix = f"the model takes one size of {name} alone", "export it with free sizes"
            raise MethodError(what, expected=str(node.shape), got=str(shape), fix=fix)
        kind = np.dtype(_NUMBERS[node.type])
        return np.ascontiguousarray(np.rint(arranged) if kind.kind == "u" else arranged, kind)


class OnnxMethod(_Network):
    """Depth from an in-focus and a defocus image, by the network of an ONNX file."""

    def __call__(self, infocus: Image, defocus: Image) -> Any:
        """Return depth, or depth and sigma, for two RGB images of uint8, shape (y, x, 3)."""
        images = zip(self._about.inputs, (infocus, defocus), strict=True)
        given = {name: self._arranged(name, image[np.newaxis]) for name, image in images}
        return self._depth(given, infocus.shape[:2])


class OnnxStackMethod(_Network):
    """Depth from a focal stack, by the network of an ONNX file."""

    def __call__(self, stack: "xarray.DataArray") -> Any:
        """Return depth, or depth and sigma, for a stack (image, y, x, channel)."""
        about = self._about
        if about.roles == "defocus":
            stack = stack[stack["role"].values == "defocus"].sortby("focus_distance")
        images, (name,) = np.asarray(stack.values), about.inputs
        given = {name: self._arranged(name, images)}
        if about.focus_distance:
            node, distances = self._inputs[about.focus_distance], stack["focus_distance"].values
            if np.isnan(distances).any():
                fix = "run it on a set that says them, such as unseen-stack"
                raise MethodError("the focus distances are not known", where=node.name, fix=fix)
            shape = (*(1 for _ in node.shape[1:]), -1)
            given[node.name] = distances.reshape(shape).astype(_NUMBERS[node.type])
        return self._depth(given, images.shape[1:3])
