import zipfile
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.sources.middlebury import MiddleburyScenes, SceneFiles, find_scene
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from tests.conftest import TINY_DEFAULT_TOML, write_png


def test_images_are_read_as_rgb_and_zero_depth_is_unknown(
    tiny_manifest: Manifest, tiny_folder: Path
) -> None:
    red = np.zeros((24, 30, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes blue first
    write_png(tiny_folder / "One/Illum1/Exp0/view1.png", red)
    depth = np.full((24, 30), 90, np.uint8)
    depth[0, 0] = 91
    depth[3, 4] = 0
    write_png(tiny_folder / "One/disp1.png", depth)
    images = MiddleburyScenes(tiny_manifest, tiny_folder).read("One")
    assert images.infocus[0, 0, 0, 5, 5].tolist() == [255, 0, 0]
    assert np.isnan(images.depth[0, 3, 4])
    assert np.argwhere(~images.valid[0]).tolist() == [[3, 4]]


def test_without_lightings_the_default_images_are_the_set(tiny_folder: Path) -> None:
    manifest = parse_manifest(TINY_DEFAULT_TOML.encode(), "tiny-1.toml")
    for view in (1, 5):
        lit = tiny_folder / f"One/Illum1/Exp1/view{view}.png"
        lit.rename(tiny_folder / f"One/view{view}.png")
    source = MiddleburyScenes(manifest, tiny_folder)
    assert [pair.id for pair in source.available_pairs()] == ["One/view1", "One/view5"]
    assert source.read("One").infocus.shape == (2, 24, 30, 3)
    missing = manifest.pairs("test")
    assert "https://example.org/tiny/Two/view1.png" in source.missing_help(missing)


def test_default_images_stand_for_no_lighting(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    (tiny_folder / "One/Illum1/Exp1/view1.png").rename(tiny_folder / "One/view1.png")
    source = MiddleburyScenes(tiny_manifest, tiny_folder)
    missing = set(tiny_manifest.pairs()) - set(source.available_pairs())
    assert [pair.id for pair in missing] == ["One/view1/illumination1/exposure1"]
    assert "middlebury-default" in source.missing_help(tuple(missing))


def test_the_default_image_of_aloe_is_its_lighting_1_2(shared_data: Path) -> None:
    manifest = find_manifest("middlebury")
    assert manifest.default_lighting == {"illumination": 1, "exposure": 2}
    aloe = shared_data / "middlebury/ThirdSize/Aloe"
    for view in (1, 5):
        default = (aloe / f"view{view}.png").read_bytes()
        assert default == (aloe / f"Illum1/Exp2/view{view}.png").read_bytes()


def test_where_to_get_what_is_missing(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    (tiny_folder / "Two/Illum1/Exp0/view5.png").unlink()
    source = MiddleburyScenes(tiny_manifest, tiny_folder)
    missing = tuple(set(tiny_manifest.pairs()) - set(source.available_pairs()))
    help_text = source.missing_help(missing)
    assert "https://example.org/tiny/Two/Illum1/Exp0/view5.png" in help_text
    assert "middlebury-default" not in help_text


def test_a_depth_map_of_another_size_is_named(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    write_png(tiny_folder / "One/disp5.png", np.arange(24 * 31).reshape(24, 31).astype(np.uint8))
    with pytest.raises(SourceError, match="differs from the other view's") as caught:
        MiddleburyScenes(tiny_manifest, tiny_folder).read("One")
    assert "disp5.png" in str(caught.value)


def test_a_folder_without_scenes(tiny_manifest: Manifest, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no scene found"):
        MiddleburyScenes(tiny_manifest, tmp_path)
    with pytest.raises(SourceError, match="no such folder"):
        MiddleburyScenes(tiny_manifest, tmp_path / "none")


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
