import zipfile
from pathlib import Path

import pytest

from dfdbench.building.sources.middlebury import MiddleburyScenes
from dfdbench.building.sources.scene_files import SceneFiles, find_scene
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError


@pytest.mark.parametrize("above", ["", "ThirdSize", "here/ThirdSize"])
def test_the_folder_may_be_the_scenes_or_one_above(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path, above: str
) -> None:
    root = tmp_path / "root"
    (root / above).parent.mkdir(parents=True, exist_ok=True)
    tiny_folder.rename(root / above)
    assert len(MiddleburyScenes(tiny_manifest, root).available_pairs()) == 11


def archive(path: Path, members: dict[str, bytes]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    return path


@pytest.mark.parametrize("top", ["", "Third/"])
def test_a_folders_file_comes_before_an_archives(tmp_path: Path, top: str) -> None:
    packed = archive(
        tmp_path / "One-2views.zip",
        {f"{top}One/view1.png": b"packed", f"{top}One/view5.png": b"packed too"},
    )
    (tmp_path / "One").mkdir()
    (tmp_path / "One/view1.png").write_bytes(b"unpacked")
    files = SceneFiles("One", tmp_path / "One", packed)
    assert files.read("view1.png") == b"unpacked"
    assert files.read("view5.png") == b"packed too"
    assert files.where("view1.png") == str(tmp_path / "One/view1.png")
    assert files.where("view5.png") == f"{packed}, view5.png"
    assert not files.has("disp1.png")
    with pytest.raises(SourceError, match="no such file") as caught:
        files.read("disp1.png")
    assert caught.value.problems[0].where == f"{packed}, disp1.png"


def test_another_scene_of_an_archive_is_none_of_this_ones(tmp_path: Path) -> None:
    packed = archive(tmp_path / "a.zip", {"NotOne/view1.png": b"", "Two/view1.png": b""})
    assert not SceneFiles("One", None, packed).has("view1.png")


def test_without_an_archive_the_folder_is_named(tmp_path: Path) -> None:
    files = SceneFiles("One", tmp_path, None)
    assert not files.has("view1.png")
    with pytest.raises(SourceError, match="no such file") as caught:
        files.read("view1.png")
    assert caught.value.problems[0].where == str(tmp_path / "view1.png")


@pytest.mark.parametrize("above", ["", "ThirdSize", "scenes2005/ThirdSize"])
@pytest.mark.parametrize("below", ["", "zip-2views"])
def test_scenes_are_found_in_the_sites_layout_and_below_it(
    tmp_path: Path, above: str, below: str
) -> None:
    assert find_scene("One", "scenes2005", tmp_path) is None
    packed = archive(tmp_path / above / below / "One-2views.zip", {"One/view1.png": b"x"})
    found = find_scene("One", "scenes2005", tmp_path)
    assert found == SceneFiles("One", None, packed)
    assert found.has("view1.png")
    (tmp_path / above / "One").mkdir()
    both = find_scene("One", "scenes2005", tmp_path)
    assert both == SceneFiles("One", tmp_path / above / "One", packed)
    assert find_scene("Two", "scenes2005", tmp_path) is None
