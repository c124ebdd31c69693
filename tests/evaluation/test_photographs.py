import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.errors import InputError
from dfdbench.evaluation.photographs import captures_in, lone_images, read_stack


def test_pairs_are_found_at_any_depth(tmp_path: Path) -> None:
    pairs = ("a/infocus.png", "a/defocus.JPG", "b/c/infocus.png", "b/c/defocus.png")
    for name in (*pairs, "infocus.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert list(captures_in(tmp_path)) == ["a", "b/c"]
    alone = f"there is no defocus image beside it ({tmp_path / 'infocus.png'})"
    assert list(map(str, lone_images(tmp_path))) == [alone]
    (tmp_path / "defocus.png").touch()
    found = captures_in(tmp_path)
    assert found[tmp_path.name] == (tmp_path / "infocus.png", tmp_path / "defocus.png")
    (tmp_path / "stack.json").touch()
    assert captures_in(tmp_path)[tmp_path.name] == (tmp_path,)
    inner = tmp_path / tmp_path.name
    inner.mkdir()
    (inner / "stack.json").touch()
    assert captures_in(tmp_path)[tmp_path.name] == (inner,)
    assert captures_in(tmp_path)[f"{tmp_path.name}-itself"] == (tmp_path,)


def test_a_stack_keeps_all_bits_of_its_images(tmp_path: Path) -> None:
    deep = np.linspace(0, 65535, 24).astype(np.uint16).reshape(2, 4, 3)
    images: dict[str, Any] = {
        "a.png": deep,
        "b.png": (deep // 257).astype(np.uint8),
        "dark.png": deep // 16,
    }
    for name, image in images.items():
        assert cv2.imwrite(str(tmp_path / name), image[..., ::-1])
    focus = {"focus_distance": ["inf", None, 2.5]}
    said = {"images": [*images], "coordinates": focus, "attributes": {"near": None}}
    (tmp_path / "stack.json").write_text(json.dumps(said))
    stack = read_stack(tmp_path)
    np.testing.assert_array_equal(stack.focus_distance, [np.inf, np.nan, 2.5])
    np.testing.assert_array_equal(stack.values, [deep, deep // 257 * 257, deep // 16])


def test_a_description_of_a_stack_that_is_none_is_refused(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "a.png"), np.zeros((2, 4, 3), np.uint8))
    good = {"images": ["a.png"], "coordinates": {}, "attributes": {}}
    (tmp_path / "stack.json").write_text(json.dumps(good))
    assert read_stack(tmp_path).shape == (1, 2, 4, 3)
    wrong: tuple[dict[str, object], ...] = (
        {"attributes": []},
        {"attributes": {"near": "x"}},
        {"attributes": {"pair_images": [1]}},
        {"attributes": {"pair_images": [0, 1.5]}},
        {"coordinates": [1]},
        {"images": 3},
        {"images": [f"../{tmp_path.name}/a.png"]},
        {"images": [str(tmp_path / "a.png")]},
    )
    for text in (*(json.dumps(good | each) for each in wrong), "[" * 100_000, "[]"):
        (tmp_path / "stack.json").write_text(text)
        with pytest.raises(InputError, match="the stack cannot be read: "):
            read_stack(tmp_path)
