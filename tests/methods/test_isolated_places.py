import sys
from pathlib import Path

import pytest

from dfdbench.methods.isolated_places import named_paths, places_of, python_path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("published", "a/weights.bin"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_path_is_what_looks_like_one_and_is_there(here: Path) -> None:
    # A recipe's name stays one, though a file of that name lies here.
    given = {
        "recipe": "published",
        "weights": "a/weights.bin",
        "deep": [{"x": here / "a"}, 3, None],
        "absent": "no/such.bin",
        "text": "y" * 10_000,
        "odd": "a\0b",
    }
    assert named_paths(given) == ["a/weights.bin", str(here / "a")]


def test_modules_are_found_as_here_and_those_beside_the_user(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", ["/elsewhere"])
    assert python_path("theirs:predict") == [str(here), "/elsewhere"]
    # A file's own folder is found when it is loaded.
    assert python_path("theirs.py:predict") == python_path("local") == ["/elsewhere"]
    monkeypatch.setattr(sys, "path", ["", "/elsewhere"])
    assert python_path("theirs:predict") == [str(here), "/elsewhere"]


def test_a_method_reads_its_own_folder_and_what_is_named(here: Path) -> None:
    (here / "pack/inner").mkdir(parents=True)
    (here / "pack/__init__.py").write_text("raise SystemExit('imported')")
    path = [str(here), *sys.path]
    assert places_of("a/mine.py:predict", {}, path) == [Path("a")]
    assert places_of("pack.inner.deep:predict", {}, path) == [here / "pack"]
    assert places_of("no_such_module:predict", {"w": "a/weights.bin"}, path) == [
        Path("a/weights.bin")
    ]
