"""Write one of our networks of images as an ONNX file, with the description needed to run it."""

from __future__ import annotations

import io
import json
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from dfdbench.errors import InputError
from dfdbench.system.files import write_whole
from dfdbench.system.packages import needed

if TYPE_CHECKING:
    from dfdbench.methods.networks.inference import Readout

EXPORTED = ("u-net", "dfd-net")

# The operator set that onnxruntime 1.20 and later read.
_OPERATORS = 17
_DESCRIPTION = """\
# {method}, exported by dfdbench
infocus = "infocus"
defocus = "defocus"
layout = "NCHW"
colour = "rgb"
largest = 255
multiple = {multiple}
depth = "depth"
unit = "levels"
trained_on = {seen}
"""


def export_onnx(
    method: str, path: str | Path, weights: str | Path | None = None, readout: Readout | None = None
) -> Path:
    """Write a network to ``path``, and its description to the same path with the suffix ``.toml``.

    Parameters
    ----------
    method : {"u-net", "dfd-net"}
        The network.
    path : str or Path
        A path that ends in ``.onnx``.
    weights, readout
        As for `dfdbench.methods.learned.DfDNetMethod`.

    Returns
    -------
    Path
        The path of the description.

    Raises
    ------
    InputError
        If onnx or PyTorch is not installed, the method, the path's suffix or the readout is not one
        of those above, or one of the two files exists already.
    MethodError
        If there are no such weights.

    Examples
    --------
    >>> export_onnx("u-net", "u-net.onnx", weights="demo")  # doctest: +SKIP
    """
    path = Path(path)
    _require_writable(method, path)
    with needed():  # here, so that the package's names can be listed without PyTorch
        import torch

        from dfdbench.methods.networks.inference import READOUTS, LevelsOfImages
        from dfdbench.methods.networks.weights import find_weights, load_weights
    network, card = load_weights(find_weights(method, weights), method)
    readout = readout or card.configuration.get("readout", "mode")
    if readout not in READOUTS:
        expected = " or ".join(READOUTS)
        raise InputError("no such readout", where="readout", expected=expected, got=str(readout))
    multiple = int(str(network.multiple))
    image, content = torch.zeros(1, 3, 4 * multiple, 6 * multiple), io.BytesIO()
    free = {"infocus": {2: "y", 3: "x"}, "defocus": {2: "y", 3: "x"}, "depth": {1: "y", 2: "x"}}
    with warnings.catch_warnings():
        # The newer exporter needs two more packages and writes this machine's paths into the file.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            LevelsOfImages(network, readout).eval(),
            (image, image),
            content,  # type: ignore[arg-type]  # the older exporter takes a file too
            input_names=["infocus", "defocus"],
            output_names=["depth"],
            dynamic_axes=free,
            opset_version=_OPERATORS,
            dynamo=False,
        )
    write_whole(path, content.getvalue())
    description = path.with_suffix(".toml")
    text = _DESCRIPTION.format(method=method, multiple=multiple, seen=json.dumps(card.saw))
    write_whole(description, text)
    return description


def _require_writable(method: str, path: Path) -> None:
    if find_spec("onnx") is None:
        fix = "pip install 'dfdbench[onnx]'"
        raise InputError("the package onnx is not installed", where="export-onnx", fix=fix)
    if method not in EXPORTED:
        what, expected = f"{method} is no network of pairs of images", " or ".join(EXPORTED)
        raise InputError(what, where="export-onnx", expected=expected)
    if path.suffix != ".onnx":
        raise InputError("not the name of an ONNX file", where=str(path), fix="NAME.onnx")
    for file in (path, path.with_suffix(".toml")):
        if file.exists():
            fix = "name another: --out NAME.onnx"
            raise InputError("a file of that name is there", where=str(file), fix=fix)
