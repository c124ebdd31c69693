from collections.abc import Callable
from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest, released_manifests, typed_name
from dfdbench.errors import ManifestError, UnknownNameError
from tests.conftest import TINY_TOML


def test_brighter_is_nearer_in_the_newest_version_of_every_set() -> None:
    newest = {manifest.short: find_manifest(manifest.short) for manifest in released_manifests()}
    assert {manifest.depth.grows_with for manifest in newest.values()} == {"nearness"}
    assert newest["realworld"].stem == "realworld-2"


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


def test_a_name_without_version_is_the_newest() -> None:
    for manifest in released_manifests():
        assert find_manifest(manifest.stem) == manifest
        newest = max(m.version for m in released_manifests() if m.name == manifest.name)
        assert find_manifest(manifest.name).version == newest
        assert find_manifest(manifest.short).version == newest
        # What a user is told to type leads back to the very same.
        assert find_manifest(typed_name(manifest)) == manifest


def test_a_manifest_of_ones_own_is_named_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "tiny-1.toml").write_text(TINY_TOML)
    mine = find_manifest(str(tmp_path / "tiny-1.toml"))
    assert mine.stem == "tiny-1"
    assert typed_name(mine) == "tiny"
    edited = find_manifest("demo").toml.replace("network_crop = 224", "network_crop = 16")
    (tmp_path / "demo.toml").write_text(edited)
    with pytest.raises(ManifestError, match="the name of the released demo-1"):
        find_manifest(str(tmp_path / "demo.toml"))
    with pytest.raises(ManifestError, match="cannot read the manifest"):
        find_manifest("demo.toml")
