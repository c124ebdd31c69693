from pathlib import Path

import pytest

from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest, read_manifest
from dfdbench.errors import ManifestError
from tests.conftest import TINY_TOML


def test_every_problem_is_in_one_message() -> None:
    broken = (
        TINY_TOML.replace("pairs = 7", "pairs = 6")
        .replace('reader = "middlebury"', "reader = 5")
        .replace('test_scenes = ["Three"]', 'test_scenes = ["Four"]')
    )
    with pytest.raises(ManifestError) as caught:
        parse_manifest(broken.encode(), "tiny-1.toml")
    text = str(caught.value)
    for part in ("splits[1].pairs", "reader", "Four", "folds"):
        assert part in text


def test_text_that_is_no_toml(tmp_path: Path) -> None:
    for content in (b"name = ", b'name = "\xff"'):
        with pytest.raises(ManifestError, match="not a TOML file"):
            parse_manifest(content, "tiny-1.toml")
    with pytest.raises(ManifestError, match="cannot read the manifest"):
        read_manifest(tmp_path / "none.toml")


def test_a_file_is_known_by_its_bytes(tmp_path: Path, tiny_manifest: Manifest) -> None:
    file = tmp_path / "tiny-1.toml"
    file.write_text(TINY_TOML)
    assert read_manifest(file).sha256 == tiny_manifest.sha256
    file.write_text(TINY_TOML + "# looked at\n")
    assert read_manifest(file).sha256 != tiny_manifest.sha256
