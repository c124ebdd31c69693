from pathlib import Path

import pytest

from dfdbench.building.obtaining import (
    Fetching,
    download_folder,
    fetch_source,
    is_fetched,
    refuse_to_fetch,
)
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError

OFFLINE = Fetching(offline=True)


@pytest.mark.parametrize(
    ("mirror", "right"),
    [
        ("https://mirror.example/middlebury", True),
        ("http://127.0.0.1:8000", True),
        ("/data/middlebury", False),
        ("mirror.example/middlebury", False),
        ("ftp://mirror.example", False),
        ("https://", False),
        ("https:///folder", False),
    ],
)
def test_a_mirror_is_an_address(mirror: str, right: bool) -> None:
    if right:
        assert Fetching((mirror,)).mirrors == (mirror,)
        return
    with pytest.raises(InputError, match="not an address") as caught:
        Fetching(("https://right.example", mirror))
    assert mirror in caught.value.problems[0].what


def test_middlebury_alone_is_fetched_and_only_without_a_folder(tmp_path: Path) -> None:
    for name, fetched in (("middlebury", True), ("middlebury-default", True), ("demo", False)):
        assert is_fetched(find_manifest(name), None) is fetched
        assert not is_fetched(find_manifest(name), tmp_path)
    assert not is_fetched(find_manifest("realworld"), None)


def test_what_is_asked_about_fetching_is_refused_where_nothing_is_fetched(tmp_path: Path) -> None:
    demo, middlebury = find_manifest("demo"), find_manifest("middlebury")
    refuse_to_fetch(demo, None, ())
    refuse_to_fetch(middlebury, tmp_path, ())
    with pytest.raises(InputError, match="demo is not fetched here"):
        refuse_to_fetch(demo, None, ("--offline",))
    with pytest.raises(InputError, match="reads a copy on disk") as caught:
        refuse_to_fetch(middlebury, tmp_path, ("--mirror", "--offline"))
    assert caught.value.problems[0].where == "--mirror and --offline"


def test_offline_what_lies_there_is_the_source(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    source, done = fetch_source(tiny_manifest, tiny_folder, OFFLINE)
    assert (done.new, done.kept) == (0, 17)
    assert len(source.available_pairs()) == 11


def test_offline_with_nothing_there_is_told(tiny_manifest: Manifest, tmp_path: Path) -> None:
    folder = download_folder(tiny_manifest, tmp_path)
    assert folder == tmp_path / "downloads/tiny-1"
    with pytest.raises(InputError, match="no file of tiny is there") as caught:
        fetch_source(tiny_manifest, folder, OFFLINE)
    assert "build once without --offline" in caught.value.problems[0].fix
