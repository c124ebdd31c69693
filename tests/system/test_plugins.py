from pathlib import Path

import pytest

from dfdbench.errors import InputError
from dfdbench.system.plugins import offered_as


@pytest.mark.parametrize("content", [b"\xff\xfe[", b"[dfdbench.methods]\nnothing\n"])
def test_the_package_whose_list_cannot_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    folder = tmp_path / "broken-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_bytes(b"[dfdbench.methods]\nfine = mine:predict\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert offered_as("dfdbench.methods")["fine"].value == "mine:predict"
    (folder / "entry_points.txt").write_bytes(content)
    with pytest.raises(InputError, match="cannot be read") as told:
        offered_as("dfdbench.methods")
    assert told.value.problems[0].where == "broken: entry_points.txt"
