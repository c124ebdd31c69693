import json
from pathlib import Path

import cv2
import numpy as np

from dfdbench.evaluation.map_files import KeptMaps, write_depth
from dfdbench.evaluation.plan import identity_of
from dfdbench.methods.registry import load_method


def test_depth_files_hold_the_depth(tmp_path: Path) -> None:
    depth = np.array([[0, 100.25], [255, 1.5]], np.float32)
    write_depth(tmp_path / "a.npy", depth)
    write_depth(tmp_path / "deep/a.png", depth)
    assert np.array_equal(np.load(tmp_path / "a.npy"), depth)
    read = np.asarray(cv2.imread(str(tmp_path / "deep/a.png"), cv2.IMREAD_UNCHANGED))
    assert (str(read.dtype), (read / 256).tolist()) == ("uint16", depth.tolist())


def test_a_folder_s_maps_are_taken_over_from_the_same_method_and_images(tmp_path: Path) -> None:
    images = {name: tmp_path / f"{name}.png" for name in "ab"}
    for name, path in images.items():
        path.write_bytes(name.encode())
    depth = np.ones((2, 3), np.float32)

    def maps(seed: int = 0) -> KeptMaps:
        method = load_method("s-transform", {}, {})
        return KeptMaps(tmp_path / "out", method, identity_of(method, seed))

    first = maps()
    for name, sigma in (("a", None), ("deep/b", depth)):
        assert first.place_of(name, [images[name[-1]]]) is None
        first.add(name, [images[name[-1]]], depth, sigma)
    a, b = (maps().place_of(name, [images[name[-1]]]) for name in ("a", "deep/b"))
    assert (a, b) == (tmp_path / "out/a.npy", tmp_path / "out/deep/b.npz")
    assert maps().left(["a"]) == ["deep/b.npz"]
    # Another image, a map that is gone, a record that is damaged.
    images["a"].write_bytes(b"other")
    assert maps().place_of("a", [images["a"]]) is None
    (tmp_path / "out/deep/b.npz").unlink()
    assert maps().place_of("deep/b", [images["b"]]) is None
    (tmp_path / "out/.predicted.json").write_text("[]")
    assert maps().place_of("deep/b", [images["b"]]) is None


def test_maps_of_another_call_are_moved_aside(tmp_path: Path) -> None:
    image = tmp_path / "a.png"
    image.write_bytes(b"a")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").write_text("precious")
    method = load_method("s-transform", {}, {})

    def maps(seed: int) -> KeptMaps:
        return KeptMaps(tmp_path / "out", method, identity_of(method, seed))

    maps(0).add("deep/a", [image], np.ones((2, 3), np.float32), None)
    other = maps(1)
    assert other.place_of("deep/a", [image]) is None
    assert other.set_aside == tmp_path / "out.previous"
    assert sorted(path.name for path in (tmp_path / "out").rglob("*.*")) == ["mine.txt"]
    assert maps(1).set_aside is None
    assert KeptMaps(tmp_path / "out.previous", method, identity_of(method, 0)).place_of(
        "deep/a", [image]
    )
    maps(1).add("a", [image], np.ones((2, 3), np.float32), None)
    assert maps(2).set_aside == tmp_path / "out.previous-2"
    # A record that was tampered with moves nothing of elsewhere.
    found = {"maps": {"a": {"file": "../a.png", "images": ""}}}
    (tmp_path / "out/.predicted.json").write_text(json.dumps(found))
    maps(1)
    assert image.exists()
