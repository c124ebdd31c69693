from collections.abc import Callable
from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.errors import ManifestError, UnknownNameError
from tests.conftest import TINY_TOML


def test_brighter_is_nearer_in_every_set() -> None:
    assert {manifest.depth.grows_with for manifest in released_manifests()} == {"nearness"}


@pytest.mark.parametrize(
    ("ask", "name", "hint"),
    [
        (lambda: find_manifest("midlebury"), "midlebury", "did you mean middlebury"),
        (lambda: find_manifest("middlebury").pairs("tset"), "tset", "did you mean test"),
        (lambda: find_manifest("demo").pairs_of_scene("Atic"), "Atic", "did you mean Attic"),
    ],
)
def test_unknown_names_show_the_near_misses(
    ask: Callable[[], object], name: str, hint: str
) -> None:
    with pytest.raises(UnknownNameError) as caught:
        ask()
    assert name in str(caught.value)
    assert hint in str(caught.value)


def test_a_manifest_is_found_by_each_of_its_names() -> None:
    for manifest in released_manifests():
        for name in (manifest.stem, manifest.name, manifest.short):
            assert find_manifest(name) == manifest


def test_a_manifest_of_ones_own_is_named_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "tiny-1.toml").write_text(TINY_TOML)
    mine = find_manifest(str(tmp_path / "tiny-1.toml"))
    assert mine.stem == "tiny-1"
    edited = find_manifest("demo").toml.replace("network_crop = 224", "network_crop = 16")
    (tmp_path / "demo.toml").write_text(edited)
    with pytest.raises(ManifestError, match="the name of the released demo-1"):
        find_manifest(str(tmp_path / "demo.toml"))
    with pytest.raises(ManifestError, match="cannot read the manifest"):
        find_manifest("demo.toml")
