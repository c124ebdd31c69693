import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, ResultError
from dfdbench.evaluation.map_files import KeptMaps, find_predictions, write_depth
from dfdbench.evaluation.plan import identity_of
from dfdbench.methods.registry import load_method
from tests.evaluation.made_predictions import in_metres, write_all


def test_depth_files_hold_the_depth(tmp_path: Path) -> None:
    depth = np.array([[0, 100.25], [255, 1.5]], np.float32)
    write_depth(tmp_path / "a.npy", depth)
    write_depth(tmp_path / "deep/a.png", depth)
    assert np.array_equal(np.load(tmp_path / "a.npy"), depth)
    read = np.asarray(cv2.imread(str(tmp_path / "deep/a.png"), cv2.IMREAD_UNCHANGED))
    assert (str(read.dtype), (read / 256).tolist()) == ("uint16", depth.tolist())
    write_depth(tmp_path / "a.png", np.full((2, 2), 65.5, np.float32), "metres")
    for far in (65.6, np.inf):
        with pytest.raises(InputError, match="1 of 4 pixels are farther than"):
            write_depth(tmp_path / "b.png", np.array([[1, far], [2, 3]], np.float32), "metres")
    assert not (tmp_path / "b.png").exists()


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
    assert a is not None
    assert (a, b) == (tmp_path / "out/a.npy", tmp_path / "out/deep/b.npz")
    assert maps().left(["a"]) == ["deep/b.npz"]
    # A damaged map, another image, a map that is gone, a record that is damaged.
    a.write_bytes(a.read_bytes()[:-1])
    assert maps().place_of("a", [images["a"]]) is None
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
    before = KeptMaps(tmp_path / "out.previous", method, identity_of(method, 0))
    assert before.place_of("deep/a", [image])
    maps(1).add("a", [image], np.ones((2, 3), np.float32), None)
    assert maps(2).set_aside == tmp_path / "out.previous-2"
    # A record that was tampered with moves nothing of elsewhere.
    found = {"maps": {"a": {"file": "../a.png", "images": ""}}}
    (tmp_path / "out/.predicted.json").write_text(json.dumps(found))
    maps(1)
    assert image.exists()


Write = Callable[[Path, NDArray[Any]], object]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Beside the store, which lies in the test's own folder too."""
    made = tmp_path / "made"
    made.mkdir()
    return made


def image(scale: float, dtype: str, suffix: str) -> Write:
    def write(stem: Path, levels: NDArray[Any]) -> None:
        assert cv2.imwrite(f"{stem}{suffix}", np.rint(levels * scale).astype(dtype))

    return write


FORMATS: dict[str, tuple[Write, float]] = {
    "npy": (lambda stem, levels: np.save(f"{stem}.npy", levels), 0),
    "npz": (lambda stem, levels: np.savez(f"{stem}.npz", levels), 0),
    "named": (lambda stem, d: np.savez(f"{stem}.npz", other=d[:2], depth=d), 0),
    "png8": (image(1, "uint8", ".png"), 1),
    "png16": (image(256, "uint16", ".png"), 1 / 256),
    "tiff16": (image(256, "uint16", ".TIF"), 1 / 256),
    "tiff": (lambda stem, levels: cv2.imwrite(f"{stem}.tif", levels), 0),
}


def test_every_format_holds_the_same_levels(tiny_store: Dataset, folder: Path) -> None:
    for name, (write, step) in FORMATS.items():
        # Some of the formats in folders, and some of them all in one.
        truths = write_all(tiny_store, "test", folder / name, write, flat=step == 0)
        found = find_predictions(folder / name, tiny_store, "test", "levels")
        assert list(found.files) == list(tiny_store.pairs("test"))
        for pair, levels in truths.items():
            read, sigma, _ = found.read(pair, levels.shape)
            assert sigma is None
            assert read.dtype == np.float32
            np.testing.assert_allclose(read, levels, rtol=0, atol=step / 2)


def test_metres_become_levels_by_the_scale(tiny_store: Dataset, folder: Path) -> None:
    store, scale = in_metres(tiny_store)
    formats: dict[str, Write] = {
        "npy": lambda stem, levels: np.save(f"{stem}.npy", scale.to_metres(levels)),
        "png16": lambda stem, d: image(1000, "uint16", ".png")(stem, scale.to_metres(d)),
        "tiff": lambda stem, d: cv2.imwrite(f"{stem}.tiff", scale.to_metres(d).astype("f4")),
    }
    for name, write in formats.items():
        truths = write_all(store, "test", folder / name, write)
        found = find_predictions(folder / name, store, "test", "metres")
        for pair, levels in truths.items():
            # A millimetre is a level and more near at hand.
            read, _, beyond = found.read(pair, levels.shape)
            np.testing.assert_allclose(read, levels, rtol=0, atol=0.4)
            assert beyond == 0


def test_all_that_is_wrong_and_only_it_is_told(tiny_store: Dataset, folder: Path) -> None:
    write_all(tiny_store, "test", folder, lambda stem, d: np.save(f"{stem}.npy", d))
    files = sorted(folder.rglob("*.npy"))
    assert len(files) == 7
    shape = np.load(files[0]).shape
    files[0].unlink()
    np.save(files[1], np.zeros((3, 4)))
    np.save(files[2], np.full(np.load(files[2]).shape, np.nan))
    files[3].write_bytes(b"no array")
    np.savez(files[4].with_suffix(".npz"), np.load(files[4]))
    np.save(files[5], np.full(np.load(files[5]).shape, 300.0))
    (folder / "notes.txt").write_text("surplus")
    np.save(folder / "Four_view1.npy", np.zeros(shape))
    (folder / ".hidden").write_text("not looked at")
    with pytest.raises(ResultError) as raised:
        find_predictions(folder, tiny_store, "test", "levels")
    told = str(raised.value)
    assert len(raised.value.problems) == 7
    for text in (
        "pairs without a depth map: 1",
        files[0].relative_to(folder).as_posix().removesuffix(".npy"),
        "pairs with two depth maps: 1",
        "files that are no pair's depth map: 2",
        "Four_view1.npy, notes.txt",
        "holds shape (3, 4)",
        "holds NaN, no answer, in all of",
        "cannot be read: no array of numbers",
        "holds levels from 300 to 300",
        "--pairs test",
    ):
        assert text in told, text
    assert ".hidden" not in told
    assert str(files[6]) not in told


#: Whole numbers of 32 bits: levels, or times 256?
LONG = np.full((24, 31), 255, np.int32)


def test_what_is_no_depth_map_is_told(tiny_store: Dataset, folder: Path) -> None:
    cases: list[tuple[Callable[[Path], Any], str]] = [
        (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n"), "cannot be read"),
        (lambda path: cv2.imwrite(str(path), np.zeros((24, 31, 3), np.uint8)), "kind RGB"),
        (lambda path: cv2.imwrite(f"{path.with_suffix('.tif')}", LONG), "kind I"),
        (lambda path: cv2.imwrite(str(path), np.full((24, 31), 65535, np.uint16)), "255.996"),
        (lambda path: np.savez(path.with_suffix(".npz"), a=[1], b=[2]), "none of them called"),
        (lambda path: np.savez(path.with_suffix(".npz"), np.array([{}])), "cannot be read"),
        (lambda path: np.save(path.with_suffix(".npy"), np.full((24, 31), "a")), "<U1 values"),
    ]
    write_all(tiny_store, "Two", folder, lambda stem, d: np.save(f"{stem}.npy", d))
    path = min(folder.rglob("*.npy"))
    for spoil, told in cases:
        for made in path.parent.glob(f"{path.stem}.*"):
            made.unlink()
        spoil(path.with_suffix(".png"))
        with pytest.raises(ResultError, match=told) as raised:
            find_predictions(folder, tiny_store, "Two", "levels")
        assert len(raised.value.problems) == 1


def test_an_archive_that_would_fill_the_memory_is_told(
    tiny_store: Dataset, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dfdbench.system.array_files.LARGEST_ARRAY", 200)
    write_all(tiny_store, "Two", folder, lambda stem, d: np.savez_compressed(stem, 0 * d))
    with pytest.raises(ResultError, match="unpacked it is larger than any"):
        find_predictions(folder, tiny_store, "Two", "levels")


def test_what_is_no_distance(tiny_store: Dataset, folder: Path) -> None:
    with pytest.raises(ResultError) as raised:
        find_predictions(folder / "no", tiny_store, "test", "metres")
    assert "no folder of depth maps" in str(raised.value)
    assert "no depth.scale in the manifest" in str(raised.value)
    store, _ = in_metres(tiny_store)
    cases: list[tuple[Write, str]] = [
        (image(1, "uint8", ".png"), "8 bits hold no metres"),
        (lambda stem, d: np.save(f"{stem}.npy", np.where(d > 9, d, 0)), "holds no distance in"),
    ]
    for number, (write, told) in enumerate(cases):
        write_all(store, "test", folder / str(number), write)
        with pytest.raises(ResultError, match=told):
            find_predictions(folder / str(number), store, "test", "metres")
