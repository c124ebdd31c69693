"""Networks in ONNX files: what a description may say, what is refused."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import xarray

pytest.importorskip("onnxruntime", reason="needs the extra onnx")
pytest.importorskip("torch", reason="needs the extra nets")

import onnx
import onnxruntime
import torch
from torch import nn

from dfdbench.api import run
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import check_method
from dfdbench.evaluation.predict import predict
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method
from tests.process import dfdbench_without

RANDOM = np.random.default_rng(3)
SHARP, BLURRED = RANDOM.integers(0, 256, (2, 21, 30, 3)).astype(np.uint8)
PAIR = 'infocus = "a"\ndefocus = "b"\ndepth = "out"\n'
STACK = 'stack = "a"\ndepth = "out"\n'


class Net(nn.Module):
    def __init__(self, forward: Callable[..., Any]) -> None:
        super().__init__()
        self.compute = forward

    def forward(self, *images: Any) -> Any:
        return self.compute(*images)


def written(
    path: Path,
    forward: Callable[..., Any],
    about: str,
    *shapes: tuple[int, ...],
    free: bool = True,
    kind: torch.dtype = torch.float32,
) -> str:
    """Write a model of the inputs a, b, ... and the outputs out, sigma, and its description."""
    inputs = tuple(torch.ones(shape, dtype=kind) for shape in shapes)
    names = ["a", "b"][: len(shapes)]
    axes = {
        name: {axis: f"{name}{axis}" for axis, size in enumerate(shape) if size > 3}
        for name, shape in zip(names, shapes, strict=True)
    }
    count = len(forward(*inputs)) if isinstance(forward(*inputs), tuple) else 1
    torch.onnx.export(
        Net(forward),
        inputs,
        str(path),
        input_names=names,
        output_names=["out", "sigma"][:count],
        dynamic_axes=axes if free else {},
        dynamo=False,
    )
    path.with_suffix(".toml").write_text(about)
    return str(path)


def problems(name: str) -> list[str]:
    with pytest.raises(MethodError) as told:
        load_method(name, {}, {})
    return [str(problem) for problem in told.value.problems]


@pytest.fixture
def mean(tmp_path: Path) -> str:
    """The mean of both images, in levels."""
    shape = (1, 3, 8, 9)
    return written(tmp_path / "mean.onnx", lambda a, b: (a + b).mean(1) / 2, PAIR, shape, shape)


def test_pixels_and_answers_are_as_the_description_says(tmp_path: Path) -> None:
    about = (
        PAIR + 'sigma = "sigma"\nlayout = "HWC"\ncolour = "bgr"\nlargest = 1\nmultiple = 8\n'
        "mean = [0.1, 0.2, 0.3]\nstd = [0.5, 1.0, 2.0]\n"
        'unit = "metres"\nscale = -2.0\noffset = 9.0\ninverse = true\n'
    )

    def forward(a: Any, b: Any) -> Any:
        return a[..., 0] + b[..., 2] / 4, 0.1 + 0 * a[..., 0]

    name = written(tmp_path / "net.onnx", forward, about, (8, 16, 3), (8, 16, 3))
    method = load_method(name, {}, {})
    depth, sigma = method(SHARP, BLURRED)
    blue, red = SHARP[..., 2] / 255, BLURRED[..., 0] / 255
    expected = 1 / (9 - 2 * ((blue - 0.1) / 0.5 + (red - 0.3) / 2 / 4))
    np.testing.assert_allclose(depth, expected, rtol=1e-5)
    np.testing.assert_allclose(sigma, 0.2 * expected**2, rtol=1e-5)
    assert method.answers_in("levels") == "metres"


def test_whole_levels_are_given_as_they_are_and_not_scaled(tmp_path: Path) -> None:
    shapes = ((8, 16, 3),) * 2
    path = tmp_path / "net.onnx"
    about = PAIR + 'layout = "HWC"\n'
    name = written(path, lambda a, b: a[..., 0] + 0.5 * b[..., 2], about, *shapes, kind=torch.uint8)
    expected = SHARP[..., 0] + 0.5 * BLURRED[..., 2]
    assert np.array_equal(load_method(name, {}, {})(SHARP, BLURRED), expected)
    path.with_suffix(".toml").write_text(about + "largest = 1\n")
    fix = "Fix: leave largest, mean and std out of net.toml, or export it with floats"
    assert problems(name)[0] == f"a takes whole levels, 0 to 255 ({path})\n{fix}"
    assert len(problems(name)) == 2


def test_levels_are_cut_only_where_that_is_said(tmp_path: Path) -> None:
    about = PAIR + 'colour = "grey"\nlayout = "HW"\nscale = 2.0\n'
    name = written(tmp_path / "net.onnx", lambda a, b: a + 0 * b, about, (8, 16), (8, 16))
    whole = load_method(name, {}, {})(SHARP, BLURRED)
    (tmp_path / "net.toml").write_text(about + "clip = true\n")
    assert whole.max() > 255
    assert np.array_equal(load_method(name, {}, {})(SHARP, BLURRED), np.minimum(whole, 255))


def test_a_stack_goes_in_by_focus_distance(tmp_path: Path) -> None:
    images = RANDOM.integers(0, 256, (5, 8, 9, 3)).astype(np.uint8)
    distance = np.array([3.0, np.nan, 1.0, 2.0, 4.0])
    roles = ["defocus", "infocus", *["defocus"] * 3]
    axis = ("image",)
    coordinates = {"role": (axis, roles), "focus_distance": (axis, distance)}
    stack = xarray.DataArray(images, coordinates, ("image", "y", "x", "channel"))
    layouts: list[tuple[str, tuple[int, ...], Callable[..., Any]]] = [
        ("SCHW", (4, 3, 8, 9), lambda a: a[:, 0]),
        ("NSCHW", (1, 4, 3, 8, 9), lambda a: a[0, :, 0]),
        ("N(SC)HW", (1, 12, 8, 9), lambda a: a[0, ::3]),
    ]
    for layout, shape, taken in layouts:

        def forward(a: Any, b: Any, taken: Callable[..., Any] = taken) -> Any:
            weights = torch.arange(1.0, 5.0).reshape(-1, 1, 1) + b.reshape(-1, 1, 1)
            return (taken(a) * weights).sum(0) / 100

        about = STACK + 'focus_distance = "b"\n'
        about += f'layout = "{layout}"\n' * (layout != "SCHW")
        method = load_method(written(tmp_path / "net.onnx", forward, about, shape, (1, 4)), {}, {})
        assert method.takes_stack
        weights = 2 * np.arange(1, 5)[:, None, None]
        expected = (images[[2, 3, 0, 4], ..., 0] * weights).sum(0) / 100
        np.testing.assert_allclose(method(stack), expected, rtol=1e-5)
        deep = stack.astype(np.uint16) * np.uint16(257)
        np.testing.assert_allclose(method(deep), expected, rtol=1e-5)
    with pytest.raises(MethodError, match="focus distances are not known"):
        method(stack.assign_coords(focus_distance=(axis, np.full(5, np.nan))))


def test_it_is_fit_for_a_run_also_in_other_processes(mean: str) -> None:
    load = partial(load_method, mean, {}, {})
    assert [trial for trial in check_method(load(), load=load) if trial.error] == []


def test_a_run_knows_the_model_and_its_description(
    mean: str, tiny_store: Dataset, tmp_path: Path
) -> None:
    first = run(mean, tiny_store, out=tmp_path / "run")
    method = first.result.method
    assert (method.name, method.entry) == ("mean.onnx", "mean.onnx:OnnxMethod")
    assert set(first.scores["method"]) == {"mean.onnx"}
    Path(mean).with_suffix(".toml").write_text(PAIR + "scale = 0.5\n")
    done = run(mean, tiny_store, out=tmp_path / "run")
    assert "mean.toml has changed" in " ".join(done.notes)
    Path(mean).write_bytes(Path(mean).read_bytes() + b"\x2a\x00")  # an empty field of no meaning
    assert load_method(mean, {}, {}).weights_sha256 != method.weights_sha256


def test_all_that_does_not_fit_is_told_together(mean: str) -> None:
    description = Path(mean).with_suffix(".toml")
    description.write_text('infocus = "a"\ndefocus = "c"\ndepth = "depth"\ncolour = "grey"\n')
    told = problems(mean)
    assert len(told) == 4
    for problem, says in zip(
        told, ("input", "output", "besides: b", "a has another shape"), strict=True
    ):
        assert says in problem, told
    description.write_text('infocus = "a"\nlayout = "NCHX"\nmean = [1.0, 2.0]\nscale = 0.0\n')
    assert problems(mean) == [f"field is missing ({description}: depth)"]
    description.write_text(description.read_text() + 'depth = "out"\nfocus_distance = "f"\n')
    told = problems(mean)
    wrong = ("neither a pair", "only a stack", "layout", "a channel", "the same")
    for problem, says in zip(told, wrong, strict=True):
        assert says in problem, told
    description.write_text(PAIR + "colour = 3\nsize = 4\n")
    assert len(problems(mean)) == 2
    description.write_text(PAIR + 'layout = "NHWC"\n')
    assert all("Fix: correct layout or colour in mean.toml" in text for text in problems(mean))


def test_damaged_files_are_named(mean: str) -> None:
    model, about = Path(mean), Path(mean).with_suffix(".toml")
    whole, described = model.read_bytes(), about.read_bytes()
    loaded = onnx.load(model)
    loaded.ir_version = 99
    newer = loaded.SerializeToString()
    loaded.graph.initializer.add(name="more").external_data.add(key="location", value="w.bin")
    elsewhere = loaded.SerializeToString()
    for damaged, description, says in (
        (None, described, "cannot read the model"),
        (whole[:-60], described, "cannot load the model"),
        # An operator that nobody has.
        (whole.replace(b"ReduceM", b"MyOwnOp"), described, "MyOwnOpean"),
        (elsewhere, described, "weights in another file"),
        (newer, described, "Unsupported model IR version: 99"),
        (whole, None, "has no description"),
        (whole, b"\xff", "cannot read the model's description"),
    ):
        for path, content in ((model, damaged), (about, description)):
            path.unlink(missing_ok=True)
            if content is not None:
                path.write_bytes(content)
        (told,) = problems(mean)
        assert says in told
        assert str(model.parent) in told


def test_a_model_may_say_where_it_was_made(mean: str) -> None:
    model = onnx.load(mean)
    model.metadata_props.add(key="location", value="a workshop")
    node = model.graph.node[0]
    of_float = onnx.helper.make_tensor_value_info("location", onnx.TensorProto.FLOAT, None)
    for each in model.graph.node:
        each.input[:] = ["location" if name == node.output[0] else name for name in each.input]
    node.output[0] = "location"
    model.graph.value_info.append(of_float)
    onnx.save(model, mean)
    assert load_method(mean, {}, {})(SHARP, BLURRED).shape == SHARP.shape[:2]


def test_a_model_of_one_size_says_so_of_another(tmp_path: Path) -> None:
    shape = (1, 3, 8, 9)
    path = tmp_path / "net.onnx"
    name = written(path, lambda a, b: (a + b).mean(1) / 2, PAIR, shape, shape, free=False)
    method = load_method(name, {}, {})
    assert method(SHARP[:8, :9], BLURRED[:8, :9]).shape == (8, 9)
    with pytest.raises(MethodError, match="takes one size of a alone"):
        method(SHARP, BLURRED)


def test_an_answer_that_is_no_depth_map_and_parameters_are_refused(tmp_path: Path) -> None:
    shape = (1, 3, 8, 9)
    name = written(tmp_path / "net.onnx", lambda a, b: a + b, PAIR, shape, shape)
    with pytest.raises(MethodError, match="wrong output out"):
        load_method(name, {}, {})(SHARP, BLURRED)
    # The command that it names finds the model, wherever it lies.
    with pytest.raises(MethodError, match=f"dfdbench check-method {name}"):
        predict(name, (SHARP, BLURRED), align=False)
    with pytest.raises(MethodError, match="got window"):
        load_method(name, {"window": 3}, {})


def test_a_map_comes_in_the_order_of_the_layout(tmp_path: Path) -> None:
    shape, about = (1, 3, 9, 8), PAIR + 'layout = "NCWH"\n'
    name = written(tmp_path / "net.onnx", lambda a, b: (a + b).mean(1) / 2, about, shape, shape)
    expected = (SHARP.astype(float) + BLURRED).mean(2) / 2
    np.testing.assert_allclose(load_method(name, {}, {})(SHARP, BLURRED), expected, rtol=1e-5)
    written(tmp_path / "net.onnx", lambda a, b: (a + b).mean(1).transpose(1, 2), PAIR, shape, shape)
    with pytest.raises(MethodError, match="wrong output out"):
        load_method(name, {}, {})(SHARP, BLURRED)


def test_it_computes_on_one_thread_so_that_rounding_depends_on_no_number(
    mean: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Mock(wraps=onnxruntime.InferenceSession)
    monkeypatch.setattr(onnxruntime, "InferenceSession", made)
    load_method(mean, {}, {})
    options = made.call_args.args[1]
    assert (options.intra_op_num_threads, options.inter_op_num_threads) == (1, 1)


def test_without_onnxruntime_the_error_says_what_to_install(mean: str) -> None:
    done = dfdbench_without("onnxruntime", "check-method", mean)
    assert done.returncode == 2, done.stderr
    assert "onnxruntime is not installed" in done.stderr
    assert "pip install 'dfdbench[onnx]'" in done.stderr
    assert isinstance(load_method(mean, {}, {}), Method)
